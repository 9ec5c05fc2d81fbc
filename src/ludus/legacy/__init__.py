"""Games that speak the protocol of another project, driven from Python as they are.

::

    registry   which bridge a target means, and how its games are opened
    places     what stands behind the prefix of a target
    session    any of these games as a Session; world holds its batch and its episodes
    game       what a bridge must offer for that: LegacyGame
    launching  the command that starts a game, and ends it with this process
    watching   the process of a game that we started

``gymgodot`` drives projects written for GymGodot (Godot 3, JSON over a WebSocket),
``godot_gym_api`` games written for godot_gym_api (Godot 3, JSON and protobuf over TCP), and
``bevy_rl`` programs made with bevy_rl (Bevy, REST).
"""
