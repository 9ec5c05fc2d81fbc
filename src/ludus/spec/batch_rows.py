"""One agent's row of a batch: read its action as Gymnasium has it, write its observation."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, cast

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from ludus.spec import ContinuousAction
from ludus.spec.batch import ActionBatch, Batch
from ludus.spec.gymnasium_spec import SINGLE_ENTRY, read_action

__all__ = ["action_reader", "clear_outcome", "write_finals", "write_state"]


def action_reader(space: spaces.Space[Any]) -> Callable[[ActionBatch, int], Any]:
    """Return a function from an action batch and a row to an action of ``space``."""
    if isinstance(space, spaces.Discrete):
        start = int(space.start)
        return lambda actions, row: int(actions.discrete[row, 0]) + start
    if isinstance(space, spaces.MultiDiscrete):
        first = cast(NDArray[np.int64], cast(Any, space).start)
        return lambda actions, row: actions.discrete[row] + first
    if isinstance(space, spaces.MultiBinary):
        return lambda actions, row: actions.discrete[row].astype(np.int8)
    if isinstance(space, spaces.Dict):
        return _dict_reader(cast(Mapping[str, spaces.Space[Any]], cast(Any, space).spaces))
    shape, dtype = cast(tuple[int, ...], space.shape), space.dtype
    return lambda actions, row: actions.continuous[row].reshape(shape).astype(dtype)


def _dict_reader(parts: Mapping[str, spaces.Space[Any]]) -> Callable[[ActionBatch, int], Any]:
    readers: list[tuple[str, Callable[[ActionBatch, int], Any], slice, slice]] = []
    num_discrete = num_continuous = 0
    for name, space in parts.items():
        components = read_action(space)
        sizes = [part.size for part in components if isinstance(part, ContinuousAction)]
        discrete = slice(num_discrete, num_discrete + len(components) - len(sizes))
        continuous = slice(num_continuous, num_continuous + sum(sizes))
        num_discrete, num_continuous = discrete.stop, continuous.stop
        readers.append((name, action_reader(space), discrete, continuous))

    def read(actions: ActionBatch, row: int) -> dict[str, Any]:
        return {
            name: reader(
                ActionBatch(actions.discrete[:, discrete], actions.continuous[:, continuous]), row
            )
            for name, reader, discrete, continuous in readers
        }

    return read


def write_state(
    batch: Batch, row: int, observation: Any, info: Mapping[str, Any] | None = None
) -> None:
    """Write one agent's observation, and the mask in its info, into ``batch``."""
    if isinstance(observation, Mapping):
        for name, value in cast(Mapping[str, Any], observation).items():
            batch.observation[name][row] = np.reshape(value, batch.observation[name].shape[1:])
    else:
        batch.observation[SINGLE_ENTRY][row] = observation
    if batch.action_mask is not None and info is not None:
        batch.action_mask[row] = np.asarray(info["action_mask"], np.bool_)


def write_finals(batch: Batch, finals: list[tuple[int, Any]]) -> None:
    """Write the last observations of the episodes that ended, by row."""
    batch.final_index = np.asarray([row for row, _ in finals], np.int64)
    for name, array in batch.observation.items():
        rows = np.zeros((len(finals), *array.shape[1:]), array.dtype)
        for index, (_, observation) in enumerate(finals):
            is_named = isinstance(observation, Mapping)
            value = cast(Mapping[str, Any], observation)[name] if is_named else observation
            rows[index] = np.reshape(value, array.shape[1:])
        batch.final_observation[name] = rows


def clear_outcome(batch: Batch) -> None:
    """Set rewards to zero, and remove the ends of episodes."""
    batch.reward[:] = 0.0
    batch.terminated[:] = False
    batch.truncated[:] = False
    if len(batch.final_index):
        write_finals(batch, [])
