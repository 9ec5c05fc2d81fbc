"""Which learner trains a policy."""

from __future__ import annotations

import zlib
from typing import Any, cast

import numpy as np
import torch

from ludus.algorithms.learner import Learner, LearnerSettings
from ludus.algorithms.ppo import PPO
from ludus.networks.device import choose_device, uses_bfloat16
from ludus.networks.policy import Policy
from ludus.pool.interface import Pool
from ludus.settings.policy_config import PPOConfig
from ludus.settings.train_config import TrainConfig

__all__ = ["make_learners", "policy_seed"]


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
    settings = config.policies[name]
    device = choose_device(config.device)
    about = LearnerSettings(
        engine_rows=[pool.rows(name, engine) for engine in range(pool.num_engines)],
        seed=policy_seed(config.seed or 0, name),
        is_mixed=uses_bfloat16(config, device),
        is_compiled=config.compile,
    )
    with cast(Any, torch.random).fork_rng(devices=[]):
        cast(Any, torch).manual_seed(about.seed)
        policy = Policy(spec, settings).to(device)
        if isinstance(settings, PPOConfig):
            return PPO(policy, settings, about)
        from ludus.algorithms.sac import SAC

        return SAC(policy, settings, about)
