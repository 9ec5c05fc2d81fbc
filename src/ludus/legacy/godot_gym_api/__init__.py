"""Drive games made for godot_gym_api, unmodified or with our classes of the same names.

::

    opening        ludus.make("godot_gym_api:…")
    making         gymnasium.make: an environment out of spaces and functions
    env            that environment
    environment    GodotEnvironment, the base class that programs for godot_gym_api extend
    declaring      checks of what the user declares
    declared_game  a game with spaces, reward and end, which opening and env stand on
    client         GodotClient: reset, step, configure
    game           one running game: request, answer, end
    ports          at which a game listens
    connection     one connection: lengths, deadlines
    messages       what is said, without input or output
    data           the fields of an answer

Each imports only those below it.
"""

from ludus.legacy.godot_gym_api.client import GodotClient
from ludus.legacy.godot_gym_api.data import Data
from ludus.legacy.godot_gym_api.environment import GodotEnvironment
from ludus.legacy.godot_gym_api.making import make

__all__ = ["Data", "GodotClient", "GodotEnvironment", "make"]
