"""``gymnasium.make("ludus/GodotGymApi-v0", …)``."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, cast

from gymnasium import spaces

from ludus.errors import ConfigError

if TYPE_CHECKING:
    from ludus.dialects.godot_gym_api.env import GodotGymApiEnv
    from ludus.dialects.godot_gym_api.messages import State

__all__ = ["make"]

_ELEMENTARY = (spaces.Discrete, spaces.Box, spaces.MultiDiscrete, spaces.MultiBinary)


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
        settings: Arguments of :class:`~ludus.dialects.godot_gym_api.GodotClient`, such as
            ``protobuf_message_module``, ``engine_address``, ``target`` and ``command``.

    Raises:
        ConfigError: An argument cannot be used.
        EngineStartError: The game did not start, or never listened.
        EngineCrashed: It ended before we were connected.
    """
    from ludus.dialects.godot_gym_api.env import Functions, GodotGymApiEnv, observation_by_names

    _check_spaces(action_space, observation_space)
    if render_mode is not None:
        raise ConfigError(f"render_mode is {render_mode!r}, expected None")
    if get_observation is None:
        get_observation = observation_by_names(_named(observation_space))
    functions = Functions(
        get_observation=get_observation,
        get_reward=_given("get_reward", get_reward),
        is_terminated=_given("is_terminated", is_terminated),
    )
    env = GodotGymApiEnv(
        action_space, observation_space, functions, requested_observation, **settings
    )
    if configuration:
        try:
            env.configure(configuration)
        except BaseException:
            env.close()
            raise
    return env


def _check_spaces(action_space: Any, observation_space: Any) -> None:
    _check_space("action_space", action_space)
    if isinstance(observation_space, spaces.Dict):
        for name, space in cast(Any, observation_space).spaces.items():
            _check_space(f"observation_space[{name!r}]", space)
    else:
        _check_space("observation_space", observation_space)


def _check_space(name: str, space: Any) -> None:
    if not isinstance(space, _ELEMENTARY):
        names = ", ".join(kind.__name__ for kind in _ELEMENTARY)
        raise ConfigError(
            f"{name} must be one of {names}, got {space!r}",
            hint="the wire does not tell spaces: declare them in Python, as the game has them",
        )


def _named(observation_space: Any) -> spaces.Dict:
    if not isinstance(observation_space, spaces.Dict):
        raise ConfigError(
            "get_observation is missing",
            hint="give it, or an observation_space that is a Dict with the names of the data",
        )
    return cast(Any, observation_space)


def _given(name: str, function: Callable[[State], Any] | None) -> Callable[[State], Any]:
    if not callable(function):
        raise ConfigError(
            f"{name} is missing",
            hint="the wire has no reward and no end: write functions of the state, "
            '{"agent": data, "world": data}',
        )
    return function
