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
        self._drawn: list[tuple[NDArray[np.float64], ActionBatch]] = []
        self._step = 0

    def act(self, batches: Mapping[str, Batch]) -> dict[str, ActionBatch]:
        """Return the actions of the next step, among those that the masks in ``batches`` allow."""
        step = self._step % STEPS_AT_ONCE
        if step == 0:
            self._drawn = [
                _draw(policy, streams)
                for policy, streams in zip(self._policies, self._streams, strict=True)
            ]
        self._step += 1
        actions: dict[str, ActionBatch] = {}
        for policy, (draws, free) in zip(self._policies, self._drawn, strict=True):
            discrete, mask = free.discrete[step], batches[policy.name].action_mask
            if mask is not None:
                discrete = _allowed_choices(policy, draws[step], mask)
            actions[policy.name] = ActionBatch(discrete, free.continuous[step])
        return actions


def _draw(
    policy: PolicySpec, streams: Sequence[np.random.Generator]
) -> tuple[NDArray[np.float64], ActionBatch]:
    """Return numbers in [0, 1) for the choices, and the actions without a mask.

    Both are of all agents in ``STEPS_AT_ONCE`` steps: ``[steps, agents, components]``.
    """
    count = policy.num_discrete
    shape = (STEPS_AT_ONCE, policy.agents_per_world, count + policy.continuous_size)
    draws = np.concatenate([stream.random(shape) for stream in streams], axis=1)
    low, high = policy.continuous_bounds()
    continuous = (low + (high - low) * draws[..., count:]).astype(np.float32)
    discrete = np.floor(draws[..., :count] * np.asarray(policy.nvec)).astype(np.int64)
    return draws[..., :count], ActionBatch(discrete, np.clip(continuous, low, high))


def _allowed_choices(
    policy: PolicySpec, draws: NDArray[np.float64], mask: NDArray[np.bool_]
) -> NDArray[np.int64]:
    """Choose uniformly among what the mask allows; 0 where it allows nothing."""
    choices = np.zeros(draws.shape, np.int64)
    start = 0
    for part, n in enumerate(policy.nvec):
        allowed = mask[:, start : start + n]
        rank = np.floor(draws[:, part] * allowed.sum(axis=1)) + 1
        choices[:, part] = (allowed.cumsum(axis=1) >= rank[:, None]).argmax(axis=1)
        start += n
    return choices
