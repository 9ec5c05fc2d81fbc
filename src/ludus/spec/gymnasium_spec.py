"""Specs from Gymnasium spaces: entries of an observation, components of an action."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, cast

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from ludus.errors import TargetError
from ludus.spec import ActionComponent, Bound, ContinuousAction, DiscreteAction, ObservationEntry

__all__ = ["SINGLE_ENTRY", "read_action", "read_observation"]

SINGLE_ENTRY = "observation"
"""Name of the entry if the space is not a dictionary."""
SINGLE_ACTION = "action"
"""Name of the component, or the beginning of names, if the space is not a dictionary."""


def read_observation(space: spaces.Space[Any]) -> tuple[ObservationEntry, ...]:
    """Return the entries of an observation space.

    Raises:
        TargetError: It is neither a box nor a dictionary of boxes.
    """
    parts: Mapping[str, spaces.Space[Any]] = {SINGLE_ENTRY: space}
    if isinstance(space, spaces.Dict):
        parts = cast(Mapping[str, spaces.Space[Any]], cast(Any, space).spaces)
    return tuple(_read_entry(name, part) for name, part in parts.items())


def read_action(space: spaces.Space[Any]) -> tuple[ActionComponent, ...]:
    """Return the components of an action space.

    Raises:
        TargetError: It is neither discrete, nor multi-discrete, nor multi-binary, nor a bounded
            box, nor a dictionary of these.
    """
    if isinstance(space, spaces.Dict):
        parts = cast(Mapping[str, spaces.Space[Any]], cast(Any, space).spaces)
        return tuple(
            replace(part, name=name + part.name.removeprefix(SINGLE_ACTION))
            for name, inner in parts.items()
            for part in read_action(inner)
        )
    if isinstance(space, spaces.Discrete):
        return (DiscreteAction(SINGLE_ACTION, int(space.n)),)
    if isinstance(space, spaces.MultiDiscrete) and len(space.shape) == 1:
        return _choices(cast(NDArray[np.int64], cast(Any, space).nvec))
    if isinstance(space, spaces.MultiBinary) and len(space.shape) == 1:
        return _choices(np.full(space.shape, 2))
    if isinstance(space, spaces.Box) and space.is_bounded():
        size = math.prod(space.shape)
        return (ContinuousAction(SINGLE_ACTION, size, *_bounds(cast(Any, space))),)
    raise TargetError(
        f"cannot train with the action space {space}",
        "wrap the environment so that it is Discrete, MultiDiscrete, a bounded Box or a Dict of "
        "these",
    )


def _choices(sizes: NDArray[np.int64]) -> tuple[DiscreteAction, ...]:
    return tuple(DiscreteAction(f"{SINGLE_ACTION}_{i}", int(n)) for i, n in enumerate(sizes))


def _read_entry(name: str, space: spaces.Space[Any]) -> ObservationEntry:
    if not isinstance(space, spaces.Box):
        raise TargetError(
            f"cannot train with the observation {name}: {space}",
            "make it a Box or a Dict of boxes, for example with "
            "gymnasium.wrappers.FlattenObservation",
        )
    kind = np.dtype(cast(Any, space).dtype)
    dtype = "uint8" if kind == np.uint8 else "float32" if kind.kind == "f" else "int64"
    return ObservationEntry(name, dtype, space.shape or (1,), *_bounds(cast(Any, space)))


def _bounds(box: Any) -> tuple[Bound, Bound]:
    return _bound(box.low), _bound(box.high)


def _bound(values: NDArray[Any]) -> Bound:
    flat = [float(value) for value in values.flat]
    return flat[0] if len(set(flat)) == 1 else tuple(flat)
