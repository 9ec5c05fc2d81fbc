"""Which learner trains a policy: a table from algorithm names to constructors."""

from __future__ import annotations

import zlib
from typing import Any, cast

import numpy as np
import torch

from ludus.pool.interface import Pool
from ludus.train.config import TrainConfig
from ludus.train.layers import policy_settings
from ludus.train.learner import Learner
from ludus.train.policy import Policy
from ludus.train.ppo import PPO

__all__ = ["make_learners", "policy_seed"]

ALGORITHMS = {"ppo": PPO}


def make_learners(config: TrainConfig, pool: Pool) -> dict[str, Learner]:
    """Return a learner for each policy of ``pool``, by name.

    Raises:
        ConfigError: A setting of the scene is unknown or does not fit.
    """
    return {name: _make_learner(name, config, pool) for name in pool.policies}


def policy_seed(seed: int, policy: str) -> int:
    """Return a seed that no other policy of the run has."""
    entropy = (seed, zlib.crc32(policy.encode()))
    return int(np.random.SeedSequence(entropy).generate_state(1, np.uint64)[0] >> np.uint64(1))


def _make_learner(name: str, config: TrainConfig, pool: Pool) -> Learner:
    spec = pool.policies[name]
    settings = policy_settings(config, spec)
    seed = policy_seed(config.seed or 0, name)
    with cast(Any, torch.random).fork_rng(devices=[]):
        cast(Any, torch).manual_seed(seed)
        policy = Policy(spec, settings).to(config.device)
    rows = [pool.rows(name, engine) for engine in range(pool.num_engines)]
    return ALGORITHMS[settings.algorithm](policy, settings, rows, seed)
