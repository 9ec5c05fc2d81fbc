"""One episode in every world with the most probable actions, for people to watch."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from ludus.networks.policy import Player, Policy
from ludus.play.evaluation import Quota
from ludus.pool.interface import Pool

__all__ = ["RoundScore", "play_round"]

RoundScore = dict[str, float | int]
"""``{"mean_return": float, "episodes": int}``"""


def play_round(
    policies: Mapping[str, Policy], pool: Pool, seed: int, is_ending: Callable[[], bool]
) -> dict[str, RoundScore] | None:
    """Play until every slot that began has ended its first episode. Nothing is learnt.

    Args:
        policies: One for each policy of the pool.
        pool: In new episodes from here on.
        seed: Of the worlds.
        is_ending: Asked before each step, between two steps.

    Returns:
        How the episodes went, by policy; None if ``is_ending`` said so first.

    Raises:
        EngineError: The engine failed.
    """
    players = {name: Player(policy, pool.num_agents(name)) for name, policy in policies.items()}
    batches = pool.reset(seed)
    quotas = {
        name: Quota(batch, int(np.count_nonzero(batch.active))) for name, batch in batches.items()
    }
    while not all(quota.is_met for quota in quotas.values()):
        if is_ending():
            return None
        batches = pool.step({name: player.act(batches[name]) for name, player in players.items()})
        for name, quota in quotas.items():
            quota.record(batches[name])
    return {name: _score(quota) for name, quota in quotas.items() if quota.returns}


def _score(quota: Quota) -> RoundScore:
    return {"mean_return": float(np.mean(quota.returns)), "episodes": len(quota.returns)}
