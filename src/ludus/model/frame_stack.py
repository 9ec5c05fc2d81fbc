"""The last observations of each agent side by side, so that a network sees what changes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ludus.model.policy_model import stack_entries
from ludus.spec import ObservationEntry
from ludus.spec.batch import Batch

__all__ = ["FrameStack"]

Entries = dict[str, NDArray[Any]]


class FrameStack:
    """Keeps the last ``num_frames`` observations of ``n`` slots.

    Before an episode has had as many, its first observation takes the missing places.

    Args:
        entries: What one observation consists of.
        num_frames: Observations to keep; with 1, all methods return what they are given.
        num_slots: ``n``.
    """

    def __init__(
        self, entries: Iterable[ObservationEntry], num_frames: int, num_slots: int
    ) -> None:
        self._entries, self._num_frames = tuple(entries), num_frames
        # Flat frames; the arrays that are returned are views of these.
        self._frames: Entries = {}
        self._stacked: Entries = {}
        if num_frames > 1:
            stacked = stack_entries(self._entries, num_frames)
            for entry, whole in zip(self._entries, stacked, strict=True):
                frames = np.zeros((num_slots, num_frames, entry.size), entry.numpy_dtype)
                self._frames[entry.name] = frames
                self._stacked[entry.name] = frames.reshape(num_slots, *whole.shape)
        self._was_active = np.zeros(num_slots, np.bool_)

    def push(self, observation: Mapping[str, NDArray[Any]], is_first: NDArray[np.bool_]) -> Entries:
        """Take the next observations; return all frames, which the next call overwrites.

        Args:
            observation: Per entry ``dtype[n, *shape]``.
            is_first: ``bool[n]``, where an episode begins.

        Returns:
            Per entry ``dtype[n, *shape]`` of :func:`~ludus.model.policy_model.stack_entries`.
        """
        if self._num_frames == 1:
            return dict(observation)
        for name, frames in self._frames.items():
            now = observation[name].reshape(len(frames), frames.shape[2])
            frames[:, :-1] = frames[:, 1:]
            frames[:, -1] = now
            frames[is_first] = now[is_first, None]
        return self._stacked

    def push_batch(self, batch: Batch) -> Batch:
        """Return a batch in which frames take the place of observations, also of the final ones."""
        if self._num_frames == 1:
            return batch
        final: Entries = {}
        for name, frames in self._frames.items():
            last = batch.final_observation[name]
            old = frames[batch.final_index, 1:]
            whole = np.concatenate([old, last.reshape(len(last), 1, frames.shape[2])], 1)
            final[name] = whole.reshape(len(last), *self._stacked[name].shape[1:])
        is_first = ~self._was_active | batch.terminated | batch.truncated
        self._was_active[...] = batch.active
        observation = self.push(batch.observation, is_first)
        return replace(batch, observation=observation, final_observation=final)

    def forget(self, rows: NDArray[np.int64] | slice = slice(None)) -> None:
        """Note that an episode begins with the next batch in some of the slots."""
        self._was_active[rows] = False
