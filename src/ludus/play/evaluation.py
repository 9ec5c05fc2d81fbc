"""Evaluation: complete episodes, chosen before they begin."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np
import torch

from ludus.algorithms.learners import policy_seed
from ludus.errors import RunError
from ludus.networks.policy import Player, Policy
from ludus.play.episodes import EpisodeTracker
from ludus.pool.interface import Pool
from ludus.spec.batch import Batch

__all__ = ["Evaluation", "Quota", "evaluate", "seeded_generator"]

MAX_STEPS = 100_000
"""Steps after which an evaluation usually gives up waiting for episodes to end."""


@dataclass(frozen=True)
class Evaluation:
    """Returns of one policy over complete episodes.

    Attributes:
        num_episodes: How many.
        mean_return: Mean of the undiscounted returns.
        std_return: Their standard deviation.
        min_return: The lowest.
        max_return: The highest.
        mean_length: Mean of the agent steps.
        returns: All of them.
        lengths: All of them.
    """

    num_episodes: int
    mean_return: float
    std_return: float
    min_return: float
    max_return: float
    mean_length: float
    returns: tuple[float, ...]
    lengths: tuple[int, ...]

    @classmethod
    def of(cls, returns: list[float], lengths: list[int]) -> Evaluation:
        """Summarise episodes; there is at least one."""
        values = np.asarray(returns)
        return cls(
            num_episodes=len(returns),
            mean_return=float(values.mean()),
            std_return=float(values.std()),
            min_return=float(values.min()),
            max_return=float(values.max()),
            mean_length=float(np.mean(lengths)),
            returns=tuple(returns),
            lengths=tuple(lengths),
        )

    def share_reaching(self, goal_return: float) -> float:
        """Return the share of episodes, 0 to 1, whose return is at least ``goal_return``."""
        return sum(each >= goal_return for each in self.returns) / self.num_episodes


class Quota:
    """Counts the first episodes of each slot, a number fixed beforehand.

    Taking whichever episodes end first would favour short ones.

    Args:
        first: What a reset brought.
        num_episodes: Episodes to count, spread evenly over the slots that are active.

    Attributes:
        returns: Of the episodes counted so far.
        lengths: Their agent steps.
    """

    def __init__(self, first: Batch, num_episodes: int) -> None:
        self._tracker = EpisodeTracker(first.num_agents, first.num_agents)
        self._rows = slice(0, first.num_agents)
        self._tracker.begin(self._rows, first)
        slots = first.active.nonzero()[0]
        self._left = np.zeros(first.num_agents, np.int64)
        if len(slots):
            each, more = divmod(num_episodes, len(slots))
            self._left[slots] = each
            self._left[slots[:more]] += 1
        self.returns: list[float] = []
        self.lengths: list[int] = []

    @property
    def is_met(self) -> bool:
        """Whether all episodes have been counted."""
        return not self._left.any()

    def record(self, batch: Batch) -> None:
        """Take what a step of all engines brought."""
        ended = self._tracker.record(self._rows, batch)
        if not len(ended):
            return
        returns = list(self._tracker.returns)[-len(ended) :]
        lengths = list(self._tracker.lengths)[-len(ended) :]
        for slot, episode_return, length in zip(ended.tolist(), returns, lengths, strict=True):
            if self._left[slot]:
                self._left[slot] -= 1
                self.returns.append(episode_return)
                self.lengths.append(length)


def evaluate(
    policies: Mapping[str, Policy],
    pool: Pool,
    episodes: int = 20,
    *,
    sampled: Collection[str] = (),
    seed: int = 0,
    max_steps: int = MAX_STEPS,
) -> dict[str, Evaluation]:
    """Play ``episodes`` episodes of every policy and return how they went.

    The episodes are spread evenly over the slots, and each slot's first ones count. Nothing is
    learnt meanwhile; observation statistics stay as they are.

    Args:
        policies: One for each policy of the pool.
        pool: Reset before; in the middle of episodes afterwards.
        episodes: Complete episodes of each policy.
        sampled: Names of policies whose actions are drawn, as in training; the others take their
            most probable ones.
        seed: Seed of worlds and samples.
        max_steps: Steps of the pool after which it gives up waiting for episodes to end.

    Raises:
        RunError: Some episodes did not end within ``max_steps`` steps.
    """
    players = {
        name: Player(
            policy,
            pool.num_agents(name),
            seeded_generator(policy, seed) if name in sampled else None,
        )
        for name, policy in policies.items()
    }
    batches = pool.reset(seed)
    quotas = {name: Quota(batches[name], episodes) for name in policies}
    for _ in range(max_steps):
        if all(quota.is_met for quota in quotas.values()):
            break
        batches = pool.step({name: player.act(batches[name]) for name, player in players.items()})
        for name, quota in quotas.items():
            quota.record(batches[name])
    for name, quota in quotas.items():
        if not quota.is_met or not quota.returns:
            raise RunError(
                f"policy {name}: {len(quota.returns)} of {episodes} episodes ended "
                f"within {max_steps} steps",
                "set max_episode_steps, in the game or with --max-episode-steps",
            )
    return {name: Evaluation.of(quota.returns, quota.lengths) for name, quota in quotas.items()}


def seeded_generator(policy: Policy, seed: int) -> torch.Generator:
    """Return a random stream that no other policy of a run with ``seed`` has."""
    return torch.Generator(policy.device).manual_seed(policy_seed(seed, policy.spec.name))
