"""Random legal actions that depend on seed, world and step, not on how many worlds there are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ludus.spec import PolicySpec, Spec
from ludus.spec.batch import ActionBatch, Batch

__all__ = ["RandomActions"]

STEPS_AT_ONCE = 64
"""One call for many steps costs little more than one for a single step."""


class RandomActions:
    """Draws a random legal action for every agent, step by step.

    The agents of a world draw from a random stream seeded with the world's seed, so a world gets
    the same actions alone and among others.

    Args:
        spec: What the engine declared.
        world_seeds: A seed per world; those of all engines to act in all of them.
    """

    def __init__(self, spec: Spec, world_seeds: Sequence[int]) -> None:
        self._policies = spec.policies
        self._streams = [
            [np.random.default_rng([seed % (1 << 64), index]) for seed in world_seeds]
            for index in range(len(spec.policies))
        ]
        self._drawn: list[NDArray[np.float64]] = []
        self._step = 0

    def act(self, batches: Mapping[str, Batch]) -> dict[str, ActionBatch]:
        """Return the actions of the next step, among those that the masks in ``batches`` allow."""
        step = self._step % STEPS_AT_ONCE
        if step == 0:
            self._drawn = [
                np.concatenate([_draw(policy, stream) for stream in streams], axis=1)
                for policy, streams in zip(self._policies, self._streams, strict=True)
            ]
        self._step += 1
        return {
            policy.name: _to_actions(policy, drawn[step], batches[policy.name].action_mask)
            for policy, drawn in zip(self._policies, self._drawn, strict=True)
        }


def _draw(policy: PolicySpec, stream: np.random.Generator) -> NDArray[np.float64]:
    """Return numbers in [0, 1): ``float64[STEPS_AT_ONCE, agents_per_world, components]``."""
    size = policy.num_discrete + policy.continuous_size
    return stream.random((STEPS_AT_ONCE, policy.agents_per_world, size))


def _to_actions(
    policy: PolicySpec, draws: NDArray[np.float64], mask: NDArray[np.bool_] | None
) -> ActionBatch:
    count = policy.num_discrete
    low, high = policy.continuous_bounds()
    continuous = low + (high - low) * draws[:, count:]
    if mask is None:
        discrete = np.floor(draws[:, :count] * np.asarray(policy.nvec))
    else:
        discrete = _allowed_choices(policy, draws[:, :count], mask)
    return ActionBatch(discrete.astype(np.int64), np.clip(continuous.astype(np.float32), low, high))


def _allowed_choices(
    policy: PolicySpec, draws: NDArray[np.float64], mask: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Choose uniformly among what the mask allows; 0 where it allows nothing."""
    choices = np.zeros_like(draws)
    start = 0
    for part, n in enumerate(policy.nvec):
        allowed = mask[:, start : start + n]
        rank = np.floor(draws[:, part] * allowed.sum(axis=1)) + 1
        choices[:, part] = (allowed.cumsum(axis=1) >= rank[:, None]).argmax(axis=1)
        start += n
    return choices
