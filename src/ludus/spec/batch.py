"""One step of many agents as arrays: a batch of outcomes and one of actions per policy."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ludus.spec import PolicySpec

__all__ = ["ActionBatch", "Batch", "Batches", "StepTimes"]


@dataclass
class Batch:
    """All agents of one policy at one moment; ``n`` slots (PROTOCOL.md §7, "Meaning").

    ``reward``, ``terminated`` and ``truncated`` belong to the action taken on the previous batch
    and are valid only where the previous batch was ``active``. Where an episode ended,
    ``observation`` is already the first of the next one (same-step autoreset), and
    ``final_observation`` holds the last one of the old episode.

    Attributes:
        observation: Per entry ``dtype[n, *shape]``.
        reward: ``float32[n]``.
        terminated: ``bool[n]``.
        truncated: ``bool[n]``.
        active: ``bool[n]``, whether the slot acts on this observation.
        action_mask: ``bool[n, sum(nvec)]``, True = allowed; None without masks.
        final_index: ``int64[m]``, slots that ended in this step, ascending.
        final_observation: Per entry ``dtype[m, *shape]``, rows as in ``final_index``.
    """

    observation: dict[str, NDArray[Any]]
    reward: NDArray[np.float32]
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]
    active: NDArray[np.bool_]
    action_mask: NDArray[np.bool_] | None
    final_index: NDArray[np.int64]
    final_observation: dict[str, NDArray[Any]]

    @property
    def num_agents(self) -> int:
        """Number of slots."""
        return len(self.reward)

    @classmethod
    def allocate(cls, policy: PolicySpec, num_agents: int) -> Batch:
        """Return a batch of zeros with room for ``num_agents`` slots of ``policy``."""
        entries = policy.observation
        mask = np.ones((num_agents, policy.mask_size), np.bool_) if policy.mask_size else None
        return cls(
            observation={e.name: np.zeros((num_agents, *e.shape), e.numpy_dtype) for e in entries},
            reward=np.zeros(num_agents, np.float32),
            terminated=np.zeros(num_agents, np.bool_),
            truncated=np.zeros(num_agents, np.bool_),
            active=np.zeros(num_agents, np.bool_),
            action_mask=mask,
            final_index=np.zeros(0, np.int64),
            final_observation={e.name: np.zeros((0, *e.shape), e.numpy_dtype) for e in entries},
        )


@dataclass(frozen=True)
class ActionBatch:
    """Actions of all agents of one policy in wire form; ``n`` slots.

    Attributes:
        discrete: ``int64[n, num_discrete]``; ``num_discrete`` may be 0.
        continuous: ``float32[n, continuous_size]``; ``continuous_size`` may be 0.
    """

    discrete: NDArray[np.int64]
    continuous: NDArray[np.float32]

    @classmethod
    def zeros(cls, policy: PolicySpec, num_agents: int) -> ActionBatch:
        """Return zero actions for ``num_agents`` slots of ``policy``."""
        return cls(
            np.zeros((num_agents, policy.num_discrete), np.int64),
            np.zeros((num_agents, policy.continuous_size), np.float32),
        )

    def rows(self, rows: slice) -> ActionBatch:
        """Return a view of some of the slots."""
        return ActionBatch(self.discrete[rows], self.continuous[rows])


Batches = dict[str, Batch]
"""A batch per policy name."""


class StepTimes(NamedTuple):
    """How the time of one step was spent, microseconds (PROTOCOL.md §7).

    Attributes:
        tick: Ticks since the engine started.
        engine_us: The engine's own loop: physics and the game's scripts.
        bridge_us: The add-on: actions, observations, encoding and decoding.
        wait_us: Waiting for the trainer.
    """

    tick: int
    engine_us: int
    bridge_us: int
    wait_us: int
