"""What the user declares of a game whose wire tells neither spaces, nor rewards, nor ends."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

from gymnasium import spaces

from ludus.errors import ConfigError
from ludus.legacy.godot_gym_api.declared_game import Functions, observation_by_names
from ludus.legacy.godot_gym_api.messages import State
from ludus.legacy.gymgodot.spaces import check_space

__all__ = ["check_spaces", "read_functions"]


def read_functions(
    observation_space: Any,
    get_observation: Callable[[State], Any] | None,
    get_reward: Callable[[State], float] | None,
    is_terminated: Callable[[State], bool] | None,
) -> Functions:
    """Return the functions; the fields of a ``Dict`` are read by their names.

    Raises:
        ConfigError: One is missing.
    """
    if get_observation is None:
        get_observation = observation_by_names(_named(observation_space))
    return Functions(
        get_observation=get_observation,
        get_reward=_given("get_reward", get_reward),
        is_terminated=_given("is_terminated", is_terminated),
    )


def check_spaces(action_space: Any, observation_space: Any) -> None:
    """Check the spaces that the user gave.

    Raises:
        ConfigError: The wire cannot carry them.
    """
    check_space("action_space", action_space)
    if isinstance(observation_space, spaces.Dict):
        for name, space in cast(Any, observation_space).spaces.items():
            check_space(f"observation_space[{name!r}]", space)
    else:
        check_space("observation_space", observation_space)


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
