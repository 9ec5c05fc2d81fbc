"""What tests of learning share: tiny environments, one thread, small configs; for conftests."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import torch

from ludus.settings.train_config import PPOConfig, TrainConfig
from tests.training.environments import register

__all__ = ["one_thread", "small"]

register()


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


@pytest.fixture
def small(tmp_path: Path) -> Any:
    """Return a maker of small, quick, seeded configs."""

    def make(target: str = "gym:Identity-discrete-v0", **changes: Any) -> TrainConfig:
        ppo = PPOConfig(
            hidden_sizes=(16,),
            rollout_steps=8,
            minibatch_size=64,
            epochs=2,
            **changes.pop("ppo", {}),
        )
        settings: dict[str, Any] = {
            "num_worlds": 4, "num_engines": 2, "seed": 7, "total_steps": 640,
            "runs": tmp_path / "runs", "evaluation_episodes": 0, "name": "run",
            "checkpoint_every_s": None, "checkpoint_every_updates": 3, "ppo": ppo,
        }  # fmt: skip
        return TrainConfig(target=target, **{**settings, **changes})

    return make
