from __future__ import annotations

from pathlib import Path

import pytest

from ludus.settings.train_config import PPOConfig, TrainConfig
from ludus.training.loop import train
from tests.training.fixtures import one_thread, small

__all__ = ["one_thread", "small", "trained"]


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with three checkpoints; tests change copies of it."""
    config = TrainConfig(
        target="gym:Identity-discrete-v0", num_worlds=4, seed=7, total_steps=192,
        runs=tmp_path_factory.mktemp("runs"), evaluation_episodes=0, name="run",
        checkpoint_every_s=None, checkpoint_every_updates=2,
        ppo=PPOConfig(hidden_sizes=(8,), rollout_steps=8, minibatch_size=32, epochs=1),
    )  # fmt: skip
    return train(config).path
