"""One agent's row of a batch: read its action as Gymnasium has it, write its observation."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, cast

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from ludus.spec import ContinuousAction
from ludus.spec.batch import Batch
from ludus.spec.gymnasium_spec import read_action

__all__ = ["action_reader", "clear_outcome", "write_finals", "write_state", "write_states"]


ReadAction = Callable[[NDArray[np.int64], NDArray[np.float32]], Any]
"""Makes an action of an agent's discrete and continuous row."""


def action_reader(space: spaces.Space[Any]) -> ReadAction:
    """Return a function that makes an action of ``space`` of an agent's two rows."""
    if isinstance(space, spaces.Discrete):
        start = int(space.start)
        return lambda discrete, _: int(discrete[0]) + start
    if isinstance(space, spaces.MultiDiscrete):
        first = cast(NDArray[np.int64], cast(Any, space).start)
        return lambda discrete, _: discrete + first
    if isinstance(space, spaces.MultiBinary):
        return lambda discrete, _: discrete.astype(np.int8)
    if isinstance(space, spaces.Dict):
        return _dict_reader(cast(Mapping[str, spaces.Space[Any]], cast(Any, space).spaces))
    shape, dtype = cast(tuple[int, ...], space.shape), space.dtype
    return lambda _, continuous: continuous.reshape(shape).astype(dtype)


def _dict_reader(parts: Mapping[str, spaces.Space[Any]]) -> ReadAction:
    readers: list[tuple[str, ReadAction, slice, slice]] = []
    num_discrete = num_continuous = 0
    for name, space in parts.items():
        components = read_action(space)
        sizes = [part.size for part in components if isinstance(part, ContinuousAction)]
        discrete = slice(num_discrete, num_discrete + len(components) - len(sizes))
        continuous = slice(num_continuous, num_continuous + sum(sizes))
        num_discrete, num_continuous = discrete.stop, continuous.stop
        readers.append((name, action_reader(space), discrete, continuous))
    return lambda discrete, continuous: {
        name: reader(discrete[choices], continuous[numbers])
        for name, reader, choices, numbers in readers
    }


def write_state(
    batch: Batch, row: int, observation: Any, info: Mapping[str, Any] | None = None
) -> None:
    """Write one agent's observation, and the mask in its info, into ``batch``."""
    write_states(batch, [row], [observation])
    if batch.action_mask is not None and info is not None:
        batch.action_mask[row] = np.asarray(info["action_mask"], np.bool_)


def write_states(batch: Batch, rows: Sequence[int], observations: Sequence[Any]) -> None:
    """Write what some agents observe, all at once."""
    for name, values in _stacked(batch, observations):
        batch.observation[name][rows] = values


def write_finals(batch: Batch, finals: list[tuple[int, Any]]) -> None:
    """Write the last observations of the episodes that ended, by row."""
    batch.final_index = np.asarray([row for row, _ in finals], np.int64)
    for name, values in _stacked(batch, [observation for _, observation in finals]):
        batch.final_observation[name] = values.astype(batch.observation[name].dtype, copy=False)


def _stacked(batch: Batch, observations: Sequence[Any]) -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield each entry and its values, ``[n, *shape]``, of observations with the same entries."""
    names = batch.observation.keys()
    is_named = len(observations) > 0 and isinstance(observations[0], Mapping)
    if is_named and any(seen.keys() != names for seen in observations):
        raise KeyError(f"other entries than {list(names)}")
    for name, array in batch.observation.items():
        values = [seen[name] for seen in observations] if is_named else observations
        yield name, np.reshape(values, (len(observations), *array.shape[1:]))


def clear_outcome(batch: Batch) -> None:
    """Set rewards to zero, and remove the ends of episodes."""
    batch.reward[:] = 0.0
    batch.terminated[:] = False
    batch.truncated[:] = False
    if len(batch.final_index):
        write_finals(batch, [])
