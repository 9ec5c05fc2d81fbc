"""From actions to what the wire takes, and from what it brings to observations."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from ludus.errors import ActionError, ConfigError, GameError
from ludus.spec.finite import all_finite_fast

__all__ = ["check_space", "max_message_bytes", "to_action_list", "to_array", "to_observation"]

_KNOWN = (spaces.Discrete, spaces.Box, spaces.MultiDiscrete, spaces.MultiBinary)
_BYTES_PER_NUMBER = 64
_ENVELOPE_BYTES = 1 << 16


def check_space(name: str, space: Any) -> None:
    """Check a space that the user gave.

    Raises:
        ConfigError: The wire cannot carry it.
    """
    if not isinstance(space, _KNOWN):
        names = ", ".join(kind.__name__ for kind in _KNOWN)
        raise ConfigError(
            f"{name} must be one of {names}, got {space!r}",
            hint="the game does not send its spaces: declare them in Python, as the game has them",
        )


def max_message_bytes(observation_space: spaces.Space[Any]) -> int:
    """Return how long a message can be that holds one observation, at the very most."""
    size = int(np.prod(observation_space.shape or (1,)))
    return _ENVELOPE_BYTES + _BYTES_PER_NUMBER * size


def to_action_list(space: spaces.Space[Any], action: Any) -> Any:
    """Return ``action`` as lists of numbers; a discrete one is a list of one integer.

    Values beyond the bounds of a ``Box`` are sent as they are: clipping is the game's affair.

    Raises:
        ActionError: It does not fit the space.
    """
    if isinstance(space, spaces.Discrete):
        return [_one_of(space, action)]
    return _checked(*_shape_and_dtype(space), action, _action_error).tolist()


def _one_of(space: spaces.Discrete, action: Any) -> int:
    try:
        number = np.asarray(action)
    except ValueError as error:
        raise _action_error("lists of different lengths") from error
    if number.size != 1 or number.dtype.kind not in "iu":
        raise _action_error(f"{action!r} instead of one integer")
    if not space.start <= number.item() < space.start + space.n:
        raise _action_error(f"{action!r} instead of {space.start} to {space.start + space.n - 1}")
    return int(number.item())


def to_observation(space: spaces.Space[Any], value: Any, name: str) -> Any:
    """Return what the game sent as an element of the space.

    Args:
        space: The observation space.
        value: Lists of numbers.
        name: What it is called on the wire, for errors.

    Raises:
        GameError: It has another shape, or holds something that is not a finite number.
    """
    if isinstance(space, spaces.Discrete):
        return to_array((1,), np.dtype(np.int64), value, name)[0]
    return to_array(*_shape_and_dtype(space), value, name)


def to_array(shape: tuple[int, ...], dtype: np.dtype[Any], value: Any, name: str) -> NDArray[Any]:
    """Return lists of numbers that the game sent as an array; errors as :func:`to_observation`."""
    return _checked(shape, dtype, value, lambda what: _game_error(name, what))


def _shape_and_dtype(space: spaces.Space[Any]) -> tuple[tuple[int, ...], np.dtype[Any]]:
    assert space.shape is not None
    return space.shape, cast("np.dtype[Any]", space.dtype)


def _checked(
    shape: tuple[int, ...],
    dtype: np.dtype[Any],
    value: Any,
    error: Callable[[str], Exception],
) -> NDArray[Any]:
    try:
        array = np.asarray(value)
    except ValueError as reason:
        raise error("lists of different lengths") from reason
    if array.dtype.kind not in "biuf":
        raise error(f"something that is not a number: {_first_other(value)}")
    if array.shape != shape:
        raise error(f"shape {list(array.shape)} instead of {list(shape)}")
    with np.errstate(over="ignore"):
        cast_array = array.astype(dtype) if dtype.kind == "f" else array
    if not (all_finite_fast((cast_array,)) or np.isfinite(cast_array).all()):
        place = tuple(int(i) for i in np.argwhere(~np.isfinite(cast_array))[0])
        raise error(f"{array[place]} at {list(place)}")
    if dtype.kind in "iu":
        limits = np.iinfo(dtype)
        if ((array < limits.min) | (array > limits.max)).any():
            raise error(f"a number that is not {dtype}")
    return cast_array.astype(dtype, copy=False)


def _first_other(value: Any) -> str:
    """Return the first thing in nested lists that is not a number, for an error message."""
    if not isinstance(value, list):
        return repr(value)[:40]
    for item in cast(list[Any], value):
        if not isinstance(item, int | float) or isinstance(item, bool):
            return _first_other(item)
    return "a number beyond all bounds"


def _action_error(what: str) -> ActionError:
    return ActionError(f"the action does not fit action_space: {what} came")


def _game_error(name: str, what: str) -> GameError:
    return GameError(
        f"{name} does not fit observation_space: {what} came",
        hint="compare get_observation() of the game with observation_space in Python",
    )
