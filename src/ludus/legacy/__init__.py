"""Legacy bridges: games that speak the wire of another project, driven as they are.

::

    registry      which bridge a target means, and how its games are opened
    addresses     what follows the prefix of a target
    session       any legacy game as a Session; world holds its batch and its episodes
    env           any legacy game with one agent as gymnasium.Env
    game          what a bridge must offer for both: LegacyGame
    conversation  requests and answers: deadlines, errors, the end
    listening     waiting for a game, where Python is the server
    length_framing  messages with their length in front
    launching     the game's process: how it is started, watched and ended
    spaces        from actions to JSON, and from JSON to observations
    addon         our add-on in a project that was written for another one

Per bridge a package with its messages and framing, its game and its settings: ``gdrl`` (Godot RL
Agents, JSON over TCP), ``gymgodot`` (Godot 3, JSON over a WebSocket), ``godot_gym_api`` (Godot 3,
JSON and protobuf over TCP), and ``bevy_rl`` (Bevy, REST).
"""
