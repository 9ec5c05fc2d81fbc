"""Rows of a batch: read actions as Gymnasium has them, write observations."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, cast

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from ludus.spec import ContinuousAction
from ludus.spec.batch import Batch
from ludus.spec.gymnasium_spec import read_action

__all__ = ["actions_reader", "clear_outcome", "stacked", "write_finals", "write_state"]


ReadActions = Callable[[NDArray[np.int64], NDArray[np.float32]], Sequence[Any]]
"""Makes the actions of some agents of their discrete and continuous rows."""


def actions_reader(space: spaces.Space[Any]) -> ReadActions:
    """Return a function that makes actions of ``space``, one for each pair of rows."""
    if isinstance(space, spaces.Discrete):
        start = int(space.start)
        return lambda discrete, _: (discrete[:, 0] + start).tolist()
    if isinstance(space, spaces.MultiDiscrete):
        first = cast(NDArray[np.int64], cast(Any, space).start)
        return lambda discrete, _: list(discrete + first)
    if isinstance(space, spaces.MultiBinary):
        return lambda discrete, _: list(discrete.astype(np.int8))
    if isinstance(space, spaces.Dict):
        return _dict_reader(cast(Mapping[str, spaces.Space[Any]], cast(Any, space).spaces))
    shape, dtype = cast(tuple[int, ...], space.shape), space.dtype
    return lambda _, continuous: list(continuous.reshape(-1, *shape).astype(dtype))


def _dict_reader(parts: Mapping[str, spaces.Space[Any]]) -> ReadActions:
    readers: list[tuple[ReadActions, slice, slice]] = []
    num_discrete = num_continuous = 0
    for space in parts.values():
        components = read_action(space)
        sizes = [part.size for part in components if isinstance(part, ContinuousAction)]
        discrete = slice(num_discrete, num_discrete + len(components) - len(sizes))
        continuous = slice(num_continuous, num_continuous + sum(sizes))
        num_discrete, num_continuous = discrete.stop, continuous.stop
        readers.append((actions_reader(space), discrete, continuous))

    def read(discrete: NDArray[np.int64], continuous: NDArray[np.float32]) -> list[Any]:
        columns = [
            reader(discrete[:, choices], continuous[:, numbers])
            for reader, choices, numbers in readers
        ]
        return [dict(zip(parts, values, strict=True)) for values in zip(*columns, strict=True)]

    return read


def write_state(
    batch: Batch, row: int, observation: Any, info: Mapping[str, Any] | None = None
) -> None:
    """Write one agent's observation, and the mask in its info, into ``batch``."""
    for name, values in stacked(batch, [observation]).items():
        batch.observation[name][row] = values[0]
    if batch.action_mask is not None and info is not None:
        batch.action_mask[row] = np.asarray(info["action_mask"], np.bool_)


def write_finals(
    batch: Batch, rows: Sequence[int], observations: Mapping[str, NDArray[Any]]
) -> None:
    """Write the last observations of the episodes that ended: by entry, ``[len(rows), *shape]``."""
    batch.final_index = np.asarray(rows, np.int64)
    for name, values in observations.items():
        batch.final_observation[name] = values.astype(batch.observation[name].dtype, copy=False)


def stacked(batch: Batch, observations: Sequence[Any]) -> dict[str, NDArray[Any]]:
    """Return the values of each entry, ``[n, *shape]``, of n observations.

    Raises:
        ValueError: They have other shapes than the batch. TypeError, KeyError, AttributeError: They
            are of another kind, or have other entries.
    """
    names = batch.observation.keys()
    is_named = len(observations) > 0 and isinstance(observations[0], Mapping)
    if is_named and any(seen.keys() != names for seen in observations):
        raise KeyError(f"other entries than {list(names)}")
    return {
        name: np.reshape(
            cast(Any, [seen[name] for seen in observations] if is_named else observations),
            (len(observations), *array.shape[1:]),
        )
        for name, array in batch.observation.items()
    }


def clear_outcome(batch: Batch) -> None:
    """Set rewards to zero, and remove the ends of episodes."""
    batch.reward[:] = 0.0
    batch.terminated[:] = False
    batch.truncated[:] = False
    if len(batch.final_index):
        write_finals(batch, [], {name: all_[:0] for name, all_ in batch.observation.items()})
