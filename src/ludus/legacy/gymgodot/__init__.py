"""Drive unmodified GymGodot projects as ``gymnasium.Env``.

::

    opening        ludus.make("gymgodot:…")
    making         gymnasium.make, with the arguments that GymGodot had
    env            the environment
    declared_game  a game with the spaces that its user has declared, which both stand on
    frames         pictures that the game saves
    game           one running game: request, answer, end
    door           waits for the game's connection
    web_socket     one connection: texts, deadlines
    spaces         from actions to lists and from lists to observations
    messages       what is said, without input or output

Each imports only those below it.
"""

from ludus.legacy.gymgodot.making import make

__all__ = ["make"]
