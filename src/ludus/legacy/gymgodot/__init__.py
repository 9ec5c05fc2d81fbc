"""Drive unmodified GymGodot projects.

::

    making      gymnasium.make, with the arguments that GymGodot had, and ludus.make("gymgodot:…")
    env         the environment of gymnasium.make
    frames      pictures that the game saves
    game        one running game: reset, step, render, end
    connecting  starts the game, and waits for its connection
    framing     WebSocket, without input or output
    messages    what is said, without input or output
    addon       our node in the place of GymGodot's

Each imports only those below it.
"""

from ludus.legacy.gymgodot.making import make

__all__ = ["make"]
