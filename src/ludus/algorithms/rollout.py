"""What all agents of one policy lived through between two updates, in preallocated arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from ludus.networks.tensors import as_tensor
from ludus.spec import PolicySpec
from ludus.spec.batch import Batch

__all__ = ["FinalObservations", "Rollout", "SlotState", "SlotViews"]

Array = NDArray[Any]
_OUTCOMES = ("discrete", "continuous", "reward", "terminated", "truncated")


@dataclass(frozen=True)
class SlotState:
    """What ``n`` slots of one engine act on, and what they do.

    Attributes:
        observation: Per entry ``dtype[n, *shape]``.
        tensors: The same memory as tensors on the CPU.
        is_active: ``bool[n]``.
        mask: ``bool[n, mask_size]``, all True without masks.
        discrete: ``int64[n, d]``.
        continuous: ``float32[n, c]``; PPO's unclipped, SAC's in [-1, 1].
    """

    observation: dict[str, Array]
    tensors: dict[str, torch.Tensor]
    is_active: NDArray[np.bool_]
    mask: NDArray[np.bool_]
    discrete: NDArray[np.int64]
    continuous: NDArray[np.float32]

    @staticmethod
    def allocate(spec: PolicySpec, num_slots: int) -> SlotState:
        """Return a state in memory of its own, with every slot inactive."""
        observation = {
            entry.name: np.zeros((num_slots, *entry.shape), entry.numpy_dtype)
            for entry in spec.observation
        }
        return SlotState(
            observation=observation,
            tensors={name: as_tensor(array) for name, array in observation.items()},
            is_active=np.zeros(num_slots, np.bool_),
            mask=np.ones((num_slots, spec.mask_size), np.bool_),
            discrete=np.zeros((num_slots, spec.num_discrete), np.int64),
            continuous=np.zeros((num_slots, spec.continuous_size), np.float32),
        )

    def write_state(self, batch: Batch) -> None:
        """Copy what the slots will act on."""
        for name, array in self.observation.items():
            array[...] = batch.observation[name]
        self.is_active[...] = batch.active
        if batch.action_mask is not None:
            self.mask[...] = batch.action_mask


@dataclass(frozen=True)
class SlotViews(SlotState):
    """One engine's slots at one step, made beforehand so that nothing is indexed while stepping.

    Attributes:
        reward: ``float32[n]``.
        terminated: ``bool[n]``.
        truncated: ``bool[n]``.
    """

    reward: NDArray[np.float32]
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]

    def write_outcome(self, batch: Batch) -> None:
        """Copy what came of the action."""
        self.reward[...] = batch.reward
        self.terminated[...] = batch.terminated
        self.truncated[...] = batch.truncated


@dataclass(frozen=True)
class FinalObservations:
    """Last observations of ``m`` truncated episodes, for bootstrapping.

    Attributes:
        step: ``int64[m]``, step of the rollout.
        slot: ``int64[m]``, over all engines.
        observation: Per entry ``dtype[m, *shape]``.
    """

    step: NDArray[np.int64]
    slot: NDArray[np.int64]
    observation: dict[str, Array]


class Rollout:
    """``num_steps`` steps of ``num_agents`` slots.

    States have one row more than outcomes: the last row is where the rollout ended, and becomes
    the first of the next one in :meth:`restart`.
    """

    def __init__(self, policy: PolicySpec, num_steps: int, engine_rows: list[slice]) -> None:
        num_agents = max(rows.stop for rows in engine_rows)
        self.num_steps, self.num_agents = num_steps, num_agents
        states, outcomes = (num_steps + 1, num_agents), (num_steps, num_agents)
        self.observation: dict[str, Array] = {
            entry.name: np.zeros((*states, *entry.shape), entry.numpy_dtype)
            for entry in policy.observation
        }
        self.is_active = np.zeros(states, np.bool_)
        self.has_mask = policy.mask_size > 0
        self.mask = np.ones((*states, policy.mask_size), np.bool_)
        self.discrete = np.zeros((*outcomes, policy.num_discrete), np.int64)
        self.continuous = np.zeros((*outcomes, policy.continuous_size), np.float32)
        self.reward = np.zeros(outcomes, np.float32)
        self.terminated = np.zeros(outcomes, np.bool_)
        self.truncated = np.zeros(outcomes, np.bool_)
        self._rows = engine_rows
        self._finals: list[FinalObservations] = []
        self.views = [[self._view(t, rows) for t in range(num_steps + 1)] for rows in engine_rows]

    def _view(self, step: int, rows: slice) -> SlotViews:
        observation = {name: array[step, rows] for name, array in self.observation.items()}
        last = min(step, self.num_steps - 1)  # the row of the last state has no outcome to write
        return SlotViews(
            observation=observation,
            tensors={name: as_tensor(array) for name, array in observation.items()},
            is_active=self.is_active[step, rows],
            mask=self.mask[step, rows],
            discrete=self.discrete[last, rows],
            continuous=self.continuous[last, rows],
            reward=self.reward[last, rows],
            terminated=self.terminated[last, rows],
            truncated=self.truncated[last, rows],
        )

    @property
    def has_reward(self) -> bool:
        """Whether some active slot got a reward other than 0."""
        return bool(self.reward.any()) and bool(self.reward[self.is_active[:-1]].any())

    def add_finals(self, engine: int, step: int, batch: Batch) -> None:
        """Keep the final observations of episodes that were truncated, not terminated."""
        index = batch.final_index
        is_kept = batch.truncated[index] & ~batch.terminated[index]
        if not is_kept.any():
            return
        slots = index[is_kept] + self._rows[engine].start
        kept = {name: array[is_kept] for name, array in batch.final_observation.items()}
        self._finals.append(FinalObservations(np.full(len(slots), step), slots, kept))

    def finals(self) -> FinalObservations | None:
        """Return all final observations of the rollout by step and slot, None if there are none."""
        if not self._finals:
            return None
        step = np.concatenate([part.step for part in self._finals])
        slot = np.concatenate([part.slot for part in self._finals])
        # Parts of other machines come in another order, which must change nothing.
        order = np.lexsort((slot, step))
        observation = {
            name: np.concatenate([part.observation[name] for part in self._finals])[order]
            for name in self.observation
        }
        return FinalObservations(step[order], slot[order], observation)

    def take(self, start: int, stop: int) -> dict[str, Array]:
        """Return views of some steps, the state after the last one among them, by name.

        Final observations are returned once.
        """
        part = {
            f"observation.{name}": of[start : stop + 1] for name, of in self.observation.items()
        }
        part["is_active"] = self.is_active[start : stop + 1]
        if self.has_mask:
            part["mask"] = self.mask[start : stop + 1]
        for name in _OUTCOMES:
            part[name] = getattr(self, name)[start:stop]
        finals = self.finals()
        if finals is not None:
            part["final.step"], part["final.slot"] = finals.step, finals.slot
            part |= {f"final.observation.{name}": of for name, of in finals.observation.items()}
        self._finals.clear()
        return part

    def put(self, engines: range, start: int, part: Mapping[str, Array]) -> int:
        """Write what :meth:`take` of another rollout returned, that of some of the engines.

        Args:
            engines: Which of the engines of this rollout.
            start: First step.
            part: Of those engines.

        Returns:
            How many steps were written.
        """
        rows = slice(self._rows[engines[0]].start, self._rows[engines[-1]].stop)
        num_steps = len(part["reward"])
        states = slice(start, start + num_steps + 1)
        for name, array in self.observation.items():
            array[states, rows] = part[f"observation.{name}"]
        self.is_active[states, rows] = part["is_active"]
        if self.has_mask:
            self.mask[states, rows] = part["mask"]
        for name in _OUTCOMES:
            getattr(self, name)[states.start : states.stop - 1, rows] = part[name]
        if "final.step" in part:
            finals = {name: part[f"final.observation.{name}"] for name in self.observation}
            slot = part["final.slot"] + rows.start
            self._finals.append(FinalObservations(part["final.step"], slot, finals))
        return num_steps

    def lose(self, engines: range, start: int, num_steps: int) -> None:
        """Note that nobody knows what some of the engines did; their slots are inactive.

        Args:
            engines: Which of the engines of this rollout.
            start: First step. What the slots did before counts as cut off there.
            num_steps: How many.
        """
        rows = slice(self._rows[engines[0]].start, self._rows[engines[-1]].stop)
        if start:
            self.truncated[start - 1, rows] |= self.is_active[start - 1, rows]
        self.is_active[start : start + num_steps + 1, rows] = False
        for name in _OUTCOMES:
            getattr(self, name)[start : start + num_steps, rows] = 0

    def restart(self, last: int = -1) -> None:
        """Begin the next rollout where this one ended, in the state ``last``."""
        for array in (*self.observation.values(), self.is_active, self.mask):
            array[0] = array[last]
        self._finals.clear()

    def forget(self) -> None:
        """Drop what was recorded; a new first state is about to be written."""
        self._finals.clear()
