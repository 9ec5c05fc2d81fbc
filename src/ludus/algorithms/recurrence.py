"""Learning through a memory: sequences of steps, each from a state that was noted.

Truncated backpropagation through time (Williams and Peng 1990): gradients go back to the first
step of a sequence, and no further.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ludus.networks.policy import Policy

__all__ = ["Sequences", "cut_into_sequences", "run_memory"]


@dataclass(frozen=True)
class Sequences:
    """``s`` sequences of ``length`` transitions each, step by step.

    Attributes:
        start: ``float32[s, memory_size]``, what was remembered before the first step.
        keep: ``bool[length, s]``, whether what was remembered before a step counts in it: not
            where an episode began.
        is_valid: ``bool[length * s]``, transitions of active slots.
        rows: ``int64[length * s]``, where the transitions stand.
    """

    start: Tensor
    keep: Tensor
    is_valid: Tensor
    rows: Tensor

    def choose(self, index: Tensor) -> Sequences:
        """Return some of the sequences."""
        length = len(self.keep)
        return Sequences(
            self.start[index],
            self.keep[:, index],
            self.is_valid.view(length, -1)[:, index].flatten(),
            self.rows.view(length, -1)[:, index].flatten(),
        )

    def __len__(self) -> int:
        return len(self.start)


def cut_into_sequences(before: Tensor, keep: Tensor, is_valid: Tensor, length: int) -> Sequences:
    """Cut a rollout into sequences of ``length`` steps.

    Args:
        before: ``float32[steps, agents, memory_size]``, state after the step before.
        keep: ``bool[steps, agents]``, see :class:`Sequences`.
        is_valid: ``bool[steps, agents]``.
        length: Divides the number of steps.
    """
    num_steps, num_agents = keep.shape
    every = torch.arange(num_steps * num_agents, device=keep.device).view(num_steps, num_agents)

    def cut(table: Tensor) -> Tensor:
        parts = table.view(num_steps // length, length, num_agents)
        return parts.transpose(0, 1).reshape(length, -1)

    return Sequences(
        start=before[::length].flatten(0, 1),
        keep=cut(keep),
        is_valid=cut(is_valid).flatten(),
        rows=cut(every).flatten(),
    )


def run_memory(
    policy: Policy, features: Tensor, start: Tensor, keep: Tensor
) -> tuple[Tensor, Tensor]:
    """Let the memory of ``policy`` take in one step after the other.

    Args:
        policy: Has a memory.
        features: ``float32[steps * n, torso.size]``, step by step.
        start: ``float32[n, memory_size]``.
        keep: ``bool[steps, n]``.

    Returns:
        The states after each step, ``float32[steps, n, memory_size]``, and the same flat,
        ``float32[steps * n, memory_size]``.
    """
    state, states = start, list[Tensor]()
    for step, kept in zip(features.view(len(keep), len(start), -1), keep, strict=True):
        state = policy.remember(step, state * kept.unsqueeze(1)).to(start.dtype)
        states.append(state)
    stacked = torch.stack(states)
    return stacked, stacked.flatten(0, 1)
