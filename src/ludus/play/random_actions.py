"""Random legal actions that depend on seed, world and step, not on how many worlds there are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ludus.spec import PolicySpec, Spec
from ludus.spec.batch import ActionBatch, Batch

__all__ = ["RandomActions"]


class RandomActions:
    """A script of ``num_steps`` random steps for every agent of one engine.

    The agents of a world draw from a stream of their own, seeded with the world's seed, so a world
    gets the same actions alone and among others. After ``num_steps`` steps the script repeats.

    Args:
        spec: What the engine declared.
        world_seeds: A seed per world.
        num_steps: Length of the script.
    """

    def __init__(self, spec: Spec, world_seeds: Sequence[int], num_steps: int) -> None:
        self._policies = {policy.name: policy for policy in spec.policies}
        self._num_steps = num_steps
        self._draws = {
            policy.name: np.concatenate(
                [_draws(policy, index, seed, num_steps) for seed in world_seeds], axis=1
            )
            for index, policy in enumerate(spec.policies)
        }

    def at(self, step: int, batches: Mapping[str, Batch]) -> dict[str, ActionBatch]:
        """Return the actions of a step, chosen among those that the masks in ``batches`` allow."""
        return {
            name: _to_actions(
                policy, self._draws[name][step % self._num_steps], batches[name].action_mask
            )
            for name, policy in self._policies.items()
        }


def _draws(policy: PolicySpec, index: int, seed: int, num_steps: int) -> NDArray[np.float64]:
    """Return numbers in [0, 1): ``float64[num_steps, agents_per_world, components]``."""
    generator = np.random.default_rng([seed % (1 << 64), index])
    shape = (num_steps, policy.agents_per_world, policy.num_discrete + policy.continuous_size)
    return generator.random(shape)


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
