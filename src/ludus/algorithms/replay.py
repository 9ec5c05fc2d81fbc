"""A ring buffer of transitions in preallocated arrays.

Both observations of a transition are stored, although the next one is mostly the first one of
another transition: finding it again would cost every sample more than the memory is worth.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ludus.algorithms.rollout import SlotState
from ludus.errors import CheckpointError
from ludus.networks.tensors import as_tensor
from ludus.spec import PolicySpec
from ludus.spec.batch import Batch

__all__ = ["Replay", "Sample", "transitions"]

Array = NDArray[Any]


@dataclass(frozen=True)
class Sample:
    """``n`` transitions, as they were recorded.

    Attributes:
        observation: Per entry ``dtype[n, *shape]``.
        next_observation: The same after the action.
        discrete: ``int64[n, d]``.
        continuous: ``float32[n, c]`` in [-1, 1].
        reward: ``float32[n]``.
        is_terminated: ``bool[n]``, whether nothing came after the action.
        mask: ``bool[n, mask_size]`` of the actions allowed; None without masks.
        next_mask: The same after the action.
    """

    observation: dict[str, Tensor]
    next_observation: dict[str, Tensor]
    discrete: Tensor
    continuous: Tensor
    reward: Tensor
    is_terminated: Tensor
    mask: Tensor | None
    next_mask: Tensor | None


class Replay:
    """The newest ``capacity`` transitions, over all slots.

    Attributes:
        size: Transitions it holds.
    """

    def __init__(self, spec: PolicySpec, capacity: int) -> None:
        self.capacity, self.size = capacity, 0
        self._position = 0
        self._names = [entry.name for entry in spec.observation]
        self._has_mask = spec.mask_size > 0
        self._arrays: dict[str, Array] = {}
        for entry in spec.observation:
            for kind in ("observation", "next_observation"):
                shape = (capacity, *entry.shape)
                self._arrays[f"{kind}.{entry.name}"] = np.zeros(shape, entry.numpy_dtype)
        self._arrays["discrete"] = np.zeros((capacity, spec.num_discrete), np.int64)
        self._arrays["continuous"] = np.zeros((capacity, spec.continuous_size), np.float32)
        self._arrays["reward"] = np.zeros(capacity, np.float32)
        self._arrays["is_terminated"] = np.zeros(capacity, np.bool_)
        if self._has_mask:
            self._arrays["mask"] = np.zeros((capacity, spec.mask_size), np.bool_)
            self._arrays["next_mask"] = np.zeros((capacity, spec.mask_size), np.bool_)
        self._tensors = {name: as_tensor(array) for name, array in self._arrays.items()}

    def add(self, fields: Mapping[str, Array]) -> int:
        """Store what :func:`transitions` returned; return how many transitions that were."""
        num_new = len(fields["reward"])
        self._write(fields, num_new)
        return num_new

    def add_transitions(self, transitions: Sample) -> None:
        """Store transitions that were collected elsewhere; tensors on the CPU."""
        groups = {
            "observation": transitions.observation,
            "next_observation": transitions.next_observation,
        }
        tensors = {f"{kind}.{name}": groups[kind][name] for kind in groups for name in self._names}
        for name in self._arrays.keys() - tensors.keys():
            tensors[name] = getattr(transitions, name)
        self._write({name: part.numpy() for name, part in tensors.items()}, len(transitions.reward))

    def sample(self, num: int, generator: torch.Generator, device: torch.device) -> Sample:
        """Draw ``num`` transitions uniformly, with replacement; copies on ``device``."""
        return self._gather(torch.randint(self.size, (num,), generator=generator), device)

    def newest(self, num: int) -> dict[str, Tensor]:
        """Return the observations acted on in the last ``num`` transitions, newest last; copies."""
        num = min(num, self.size)
        index = torch.arange(self._position - num, self._position) % self.capacity
        return self._entries("observation", index, torch.device("cpu"))

    def state(self) -> dict[str, Tensor]:
        """Return copies of the part that is filled, and where the next transition goes."""
        filled = {name: tensor[: self.size].clone() for name, tensor in self._tensors.items()}
        return filled | {"position": torch.tensor([self._position, self.size, self.capacity])}

    def load_state(self, state: Mapping[str, Tensor]) -> None:
        """Go on from :meth:`state`.

        Raises:
            CheckpointError: It is that of another policy, or of another capacity.
        """
        names = self._arrays.keys() | {"position"}
        if set(state) != names or int(state["position"][2]) != self.capacity:
            raise CheckpointError(
                f"the replay of the checkpoint does not fit: {self.capacity} transitions of "
                f"{', '.join(sorted(self._arrays))} were expected",
                "resume with the replay_capacity it was trained with",
            )
        self._position, self.size = int(state["position"][0]), int(state["position"][1])
        for name, tensor in self._tensors.items():
            tensor[: self.size] = state[name]

    def _write(self, fields: Mapping[str, Array], num_new: int) -> None:
        """Write rows behind the last ones, over the oldest, around the end if need be."""
        skipped = max(0, num_new - self.capacity)
        num_rows = num_new - skipped
        start = (self._position + skipped) % self.capacity
        num_head = min(num_rows, self.capacity - start)
        for name, values in fields.items():
            array = self._arrays[name]
            array[start : start + num_head] = values[skipped : skipped + num_head]
            if num_head < num_rows:
                array[: num_rows - num_head] = values[skipped + num_head :]
        self._position = (self._position + num_new) % self.capacity
        self.size = min(self.size + num_new, self.capacity)

    def _gather(self, index: Tensor, device: torch.device) -> Sample:
        def take(name: str) -> Tensor:
            return self._tensors[name].index_select(0, index).to(device)

        return Sample(
            observation=self._entries("observation", index, device),
            next_observation=self._entries("next_observation", index, device),
            discrete=take("discrete"),
            continuous=take("continuous"),
            reward=take("reward"),
            is_terminated=take("is_terminated"),
            mask=take("mask") if self._has_mask else None,
            next_mask=take("next_mask") if self._has_mask else None,
        )

    def _entries(self, kind: str, index: Tensor, device: torch.device) -> dict[str, Tensor]:
        return {
            name: self._tensors[f"{kind}.{name}"].index_select(0, index).to(device)
            for name in self._names
        }


def transitions(last: SlotState, batch: Batch) -> dict[str, Array]:
    """Return what came of the actions of ``last``, for the slots that were active then, by name.

    Where an episode ended, the next observation is the final one, not the batch's, which is the
    first of the next episode. A slot that falls silent without an end has terminated. Where a
    truncated episode has no final observation, because its engine vanished, nobody knows where the
    action led, and the transition is left out. The final observation has no mask; that of the state
    before it stands in.

    Returns:
        Rows of the arrays of a replay; views of ``last`` and ``batch``, where all slots are kept.
    """
    fields: dict[str, Array] = {
        "discrete": last.discrete,
        "continuous": last.continuous,
        "reward": batch.reward,
        "is_terminated": batch.terminated | ~(batch.active | batch.truncated),
    }
    for name, observation in last.observation.items():
        fields[f"observation.{name}"] = observation
        fields[f"next_observation.{name}"] = _next_observation(batch, name)
    if batch.action_mask is not None:
        fields["mask"] = last.mask
        is_truncated = batch.truncated[:, np.newaxis]
        fields["next_mask"] = np.where(is_truncated, last.mask, batch.action_mask)
    is_kept = last.is_active
    if batch.truncated.any():
        is_kept = is_kept & ~_is_lost(batch)
    if not is_kept.all():
        fields = {name: values[is_kept] for name, values in fields.items()}
    return fields


def _next_observation(batch: Batch, name: str) -> Array:
    """Return ``dtype[n, *shape]``: where actions led, in one entry."""
    if not len(batch.final_index):
        return batch.observation[name]
    result = batch.observation[name].copy()
    result[batch.final_index] = batch.final_observation[name]
    return result


def _is_lost(batch: Batch) -> NDArray[np.bool_]:
    """Return ``bool[n]``, whether an episode was cut off without a final observation."""
    is_lost = batch.truncated & ~batch.terminated
    is_lost[batch.final_index] = False
    return is_lost
