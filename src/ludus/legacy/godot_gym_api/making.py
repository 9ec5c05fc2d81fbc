"""``gymnasium.make("ludus/GodotGymApi-v0", …)``."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from ludus.errors import ConfigError
from ludus.legacy.game import Declaration

if TYPE_CHECKING:
    from ludus.legacy.godot_gym_api.env import GodotGymApiEnv
    from ludus.legacy.godot_gym_api.messages import State

__all__ = ["make"]


def make(
    *,
    action_space: Any = None,
    observation_space: Any = None,
    get_reward: Callable[[State], float] | None = None,
    is_terminated: Callable[[State], bool] | None = None,
    get_observation: Callable[[State], Any] | None = None,
    requested_observation: Mapping[str, Any] | None = None,
    configuration: Mapping[str, Any] | None = None,
    render_mode: str | None = None,
    **settings: Any,
) -> GodotGymApiEnv:
    """Connect with a game, or start one.

    Args:
        action_space: What the game's ``set_action`` takes: ``Discrete`` (it gets a number),
            ``Box``, ``MultiDiscrete`` or ``MultiBinary`` (lists).
        observation_space: What ``get_observation`` returns: one of these, or a ``Dict`` of them.
        get_reward: Returns the reward for a state ``{"agent": data, "world": data}``.
        is_terminated: Returns whether the episode has ended in a state.
        get_observation: Returns the observation for a state. Left out: each entry of the ``Dict``
            is the field of that name, of agent or world.
        requested_observation: What the game is asked for, ``{"agent": […], "world": […]}``.
        configuration: ``{"agent": {…}, "world": {…}, "environment": {"repeat_action": 4}}``, told
            once at the beginning.
        render_mode: Only None: the wire has no pictures of the screen.
        settings: Arguments of :class:`~ludus.legacy.godot_gym_api.GodotClient`, such as
            ``protobuf_message_module``, ``engine_address``, ``target`` and ``command``.

    Raises:
        ConfigError: An argument cannot be used.
        EngineStartError: The game did not start, or never listened.
        EngineCrashed: It ended before we were connected.
    """
    from ludus.legacy.godot_gym_api.declaring import check_spaces, read_functions
    from ludus.legacy.godot_gym_api.env import GodotGymApiEnv

    check_spaces(action_space, observation_space)
    if render_mode is not None:
        raise ConfigError(f"render_mode is {render_mode!r}, expected None")
    functions = read_functions(observation_space, get_observation, get_reward, is_terminated)
    declaration = Declaration(
        name="godot_gym_api", observation_space=observation_space, action_space=action_space
    )
    env = GodotGymApiEnv(declaration, functions, requested_observation, **settings)
    if configuration:
        try:
            env.configure(configuration)
        except BaseException:
            env.close()
            raise
    return env
