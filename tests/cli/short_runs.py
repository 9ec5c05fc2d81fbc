"""Runs that are over in a moment."""

from __future__ import annotations

from pathlib import Path

from ludus.settings.train_config import PPOConfig, TrainConfig
from ludus.training.loop import train


def short_run(runs: Path, name: str = "run") -> Path:
    """Return the folder of a run on CartPole-v1 that has ended after four updates."""
    config = TrainConfig(
        target="gym:CartPole-v1", num_worlds=2, num_engines=1, total_steps=64, seed=7,
        runs=runs, name=name, evaluation_episodes=0,
        ppo=PPOConfig(rollout_steps=8, hidden_sizes=(8,)),
    )  # fmt: skip
    return train(config).path
