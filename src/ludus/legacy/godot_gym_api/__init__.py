"""Drive games made for godot_gym_api, unmodified or with our classes of the same names.

::

    making       gymnasium.make and ludus.make("godot_gym_api:…")
    game         a game with spaces, reward and end
    environment  GodotEnvironment, the base class that programs for godot_gym_api extend
    client       GodotClient: reset, step, configure
    connecting   starts a game or finds it, and connects
    messages     what is said, without input or output
    data         the fields of an answer
    addon        our classes in the place of godot_gym_api's

Each imports only those below it.
"""

from ludus.legacy.godot_gym_api.client import GodotClient
from ludus.legacy.godot_gym_api.data import Data
from ludus.legacy.godot_gym_api.environment import GodotEnvironment
from ludus.legacy.godot_gym_api.making import make

__all__ = ["Data", "GodotClient", "GodotEnvironment", "make"]
