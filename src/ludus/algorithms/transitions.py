"""What PPO learns from."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

from torch import Tensor

from ludus.algorithms.recurrence import Sequences
from ludus.networks.networks import Inputs
from ludus.networks.tensors import take_rows

__all__ = ["Transitions", "equal_parts"]


@dataclass(frozen=True)
class Transitions:
    """``n`` transitions to learn from; all slots that were active.

    Attributes:
        inputs: What was observed.
        discrete: ``int64[n, d]``.
        continuous: ``float32[n, c]``, as sampled.
        mask: ``bool[n, mask_size]``, None without masks.
        log_prob: ``float32[n]``, of the action when it was taken.
        value: ``float32[n]``, V of the state when the action was taken.
        advantage: ``float32[n]``.
        target: ``float32[n]``, what the value should have been.
        sequences: With a memory, how the rows follow each other; inactive slots are then among
            them. None without a memory.
    """

    inputs: Inputs
    discrete: Tensor
    continuous: Tensor
    mask: Tensor | None
    log_prob: Tensor
    value: Tensor
    advantage: Tensor
    target: Tensor
    sequences: Sequences | None = None

    def rows(self, index: Tensor | slice) -> Transitions:
        """Return a copy of some of the transitions, or a view for a slice."""
        return Transitions(
            self.inputs.rows(index),
            take_rows(self.discrete, index),
            take_rows(self.continuous, index),
            None if self.mask is None else take_rows(self.mask, index),
            take_rows(self.log_prob, index),
            take_rows(self.value, index),
            take_rows(self.advantage, index),
            take_rows(self.target, index),
        )

    @property
    def valid_rows(self) -> Tensor | slice:
        """Those of active slots: with a memory some, otherwise all."""
        sequences = self.sequences
        return slice(None) if sequences is None else sequences.rows[sequences.is_valid]

    def __len__(self) -> int:
        return len(self.log_prob)


def equal_parts(length: int, num_parts: int) -> list[slice]:
    """Return slices that cut ``length`` rows into parts of nearly equal size."""
    bounds = [length * part // num_parts for part in range(num_parts + 1)]
    return [slice(start, stop) for start, stop in itertools.pairwise(bounds)]
