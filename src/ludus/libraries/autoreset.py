"""When a new episode begins: in the step that ends the old one, in the next step, or when asked.

Engines begin the next episode at once (PROTOCOL.md §7). The other two of Gymnasium's autoreset
modes hand out its first observation later, and see to it that its world has not moved meanwhile.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from ludus.errors import SequenceError, UsageError
from ludus.pool import EnginePool
from ludus.spec.batch import ActionBatch, Batch, Batches
from ludus.wire.reset import ResetAction, ResetRequest

__all__ = ["SameStep", "read_mode", "stepper_of"]


def read_mode(mode: str | AutoresetMode) -> AutoresetMode:
    """Return one of Gymnasium's autoreset modes.

    Raises:
        UsageError: There is no such mode.
    """
    names = {
        name: known for known in AutoresetMode for name in (known.name.lower(), known.value, known)
    }
    if mode not in names:
        raise UsageError(
            f"autoreset_mode is {mode!r}, expected 'same_step', 'next_step' or 'disabled'"
        )
    return names[mode]


def stepper_of(pool: EnginePool, mode: AutoresetMode) -> SameStep:
    """Return what steps ``pool`` in that mode.

    Raises:
        UsageError: The mode needs worlds that stand still, and those of ``pool`` never may: their
            agents end one by one.
    """
    if mode is AutoresetMode.SAME_STEP:
        return SameStep(pool)
    num_agents = sum(policy.agents_per_world for policy in pool.policies.values())
    if num_agents > 1 and any(policy.episode == "agent" for policy in pool.policies.values()):
        raise UsageError(
            f"autoreset_mode {mode.name.lower()!r} lets a world stand still while an agent waits, "
            f"but in a world of this game {num_agents} agents end one by one",
            hint="use 'same_step'; or set episode_mode of the game's LudusWorld to WORLD",
        )
    return (NextStep if mode is AutoresetMode.NEXT_STEP else OnRequest)(pool)


class SameStep:
    """The step that ends an episode returns the first observation of the next one.

    Args:
        pool: What is stepped.

    Attributes:
        is_over: ``bool[num_worlds]``, where an episode has ended and the next one has not been
            handed out; False everywhere in this mode.
    """

    def __init__(self, pool: EnginePool) -> None:
        self._pool = pool
        self.is_over = np.zeros(pool.num_worlds, np.bool_)

    def reset(self, request: ResetRequest) -> Batches:
        """Begin new episodes; returns copies."""
        return self._pool.reset_worlds(request)

    def step(self, actions: Mapping[str, ActionBatch]) -> Batches:
        """Step all worlds; returns copies, with final observations at the side."""
        return self._pool.step(actions)


class _HoldsBeginnings(SameStep):
    """Shows the last observation of an episode where it ended, and later the first of the next.

    A world *is over* from the step in which the last of its agents ended until the next episode is
    handed out.
    """

    def __init__(self, pool: EnginePool) -> None:
        super().__init__(pool)
        self._active: dict[str, NDArray[np.bool_]] = {}
        self._shown: Batches = {}

    def reset(self, request: ResetRequest) -> Batches:
        """Begin new episodes; where one has begun already, and no seed was given, hand it out.

        Where that is all, or no world is chosen, the engines are not asked, and so need not be able
        to reset some of their worlds only.

        Raises:
            SequenceError: The first reset chooses no world.
        """
        is_chosen = request.actions != ResetAction.LEAVE
        is_held = self.is_over & (request.actions == ResetAction.NEXT_EPISODE)
        is_held &= [_parameters_of(request, world) is None for world in range(len(is_held))]
        rest = np.where(is_held, ResetAction.LEAVE, request.actions).astype(np.uint8)
        if rest.any():
            batches = self._pool.reset_worlds(replace(request, actions=rest))
        else:
            latest = self._pool.latest()
            batches = {name: _without_outcome(batch) for name, batch in latest.items()}
        self._active = {name: batch.active.copy() for name, batch in batches.items()}
        self.is_over &= ~is_chosen
        if self.is_over.any():
            self._show_again(batches)
        return batches

    def _take(self, batches: Batches) -> Batches:
        """Note which worlds are over; return what is to be shown."""
        self.is_over = self._find_over(batches)
        self._active = {name: batch.active.copy() for name, batch in batches.items()}
        if not self.is_over.any():
            return batches
        self._shown = {}
        for name, batch in batches.items():
            self._shown[name] = _show_last(batch, self._rows(self.is_over, name))
        return self._shown

    def _find_over(self, batches: Batches) -> NDArray[np.bool_]:
        """Return the worlds in which the last agents that still acted ended in this step."""
        ends, goes_on = np.zeros((2, self._pool.num_worlds), np.bool_)
        for name, policy in self._pool.policies.items():
            ended = (batches[name].terminated | batches[name].truncated) & self._active[name]
            shape = (-1, policy.agents_per_world)
            ends |= ended.reshape(shape).any(1)
            goes_on |= (self._active[name] & ~ended).reshape(shape).any(1)
        return ends & ~goes_on

    def _show_again(self, batches: Batches) -> None:
        """Leave worlds that are over as they were shown."""
        for name, batch in batches.items():
            rows = self._rows(self.is_over, name)
            for entry, values in batch.observation.items():
                values[rows] = self._shown[name].observation[entry][rows]

    def _rows(self, worlds: NDArray[np.bool_], policy: str) -> NDArray[np.bool_]:
        return np.repeat(worlds, self._pool.policies[policy].agents_per_world)


class NextStep(_HoldsBeginnings):
    """The step after the end of an episode ignores the action and begins the next one."""

    def step(self, actions: Mapping[str, ActionBatch]) -> Batches:
        """Step the worlds that are not over, and hand out the beginnings of those that are."""
        return self._take(self._pool.step(actions, self.is_over if self.is_over.any() else None))


class OnRequest(_HoldsBeginnings):
    """The next episode begins with ``reset(options={"reset_mask": …})``."""

    def step(self, actions: Mapping[str, ActionBatch]) -> Batches:
        """Step all worlds.

        Raises:
            SequenceError: One of them is over.
        """
        if self.is_over.any():
            raise SequenceError(
                f"world {self.is_over.argmax()} is over, and so are {self.is_over.sum()} in all",
                hint='reset(options={"reset_mask": terminated | truncated}) begins new episodes',
            )
        return self._take(self._pool.step(actions))


def _parameters_of(request: ResetRequest, world: int) -> object:
    given = request.parameters
    return given if given is None or isinstance(given, Mapping) else given[world]


def _show_last(batch: Batch, rows: NDArray[np.bool_]) -> Batch:
    """Return a batch with last observations in place, and nothing of the episodes in ``rows``."""
    observation = {entry: values.copy() for entry, values in batch.observation.items()}
    mask = None if batch.action_mask is None else batch.action_mask.copy()
    if mask is not None:
        mask[rows] = True
    for entry, values in observation.items():
        values[rows] = 0  # agents that had ended before
        values[batch.final_index] = batch.final_observation[entry]
    active = batch.active.copy()
    active[rows] = False
    active[batch.final_index] = True
    return replace(batch, observation=observation, active=active, action_mask=mask)


def _without_outcome(batch: Batch) -> Batch:
    """Return a copy of what the agents see, with rewards 0 and no ends."""
    return Batch(
        observation={entry: values.copy() for entry, values in batch.observation.items()},
        reward=np.zeros_like(batch.reward),
        terminated=np.zeros_like(batch.terminated),
        truncated=np.zeros_like(batch.truncated),
        active=batch.active.copy(),
        action_mask=None if batch.action_mask is None else batch.action_mask.copy(),
        final_index=batch.final_index[:0],
        final_observation={name: part[:0] for name, part in batch.final_observation.items()},
    )
