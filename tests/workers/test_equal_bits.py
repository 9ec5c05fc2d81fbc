"""However the engines of a run are spread over workers, it leaves the same bits."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from ludus.settings.train_config import PPOConfig, SACConfig, TrainConfig
from ludus.training.loop import train
from tests.workers.machines import assert_equal, newest, use_in_process

pytestmark = pytest.mark.slow

LAYOUTS = {None: 4, "local:1": 4, "local:2": 2, "local:4": 1}
"""Engines of each machine, by cluster."""

PPO: dict[str, Any] = {"hidden_sizes": (16,), "rollout_steps": 8, "minibatch_size": 48}
SAC: dict[str, Any] = {"hidden_sizes": (16,), "batch_size": 16, "learning_starts": 50,
                       "report_steps": 10, "updates_per_step": 1.7}  # fmt: skip
CASES: dict[str, tuple[str, dict[str, Any]]] = {
    "ppo": ("Identity-discrete-v0", {"ppo": PPOConfig(**PPO)}),
    "ppo continuous": ("Identity-continuous-v0", {"ppo": PPOConfig(**PPO)}),
    "ppo overlap": ("Masked-v0", {"ppo": PPOConfig(**PPO, overlap=True)}),
    "ppo memory": ("Truncated-v0", {"ppo": PPOConfig(**PPO, memory_size=8, sequence_length=4)}),
    "ppo curious": ("Truncated-v0", {"ppo": PPOConfig(**PPO, curiosity=0.5)}),
    "ppo frames": ("Truncated-v0", {"ppo": PPOConfig(**PPO, frame_stack=3)}),
    "ppo raw": (
        "Truncated-v0", {"ppo": PPOConfig(**PPO, normalise_observation=False, target_kl=0.01)},
    ),
    "sac": ("Identity-continuous-v0", {"algorithm": "sac", "sac": SACConfig(**SAC)}),
    "sac discrete": ("Masked-v0", {"algorithm": "sac", "sac": SACConfig(**SAC)}),
    "sac frames": (
        "Truncated-v0", {"algorithm": "sac", "sac": SACConfig(**SAC, frame_stack=3)},
    ),
    "sac truncated": (
        "Truncated-v0", {"algorithm": "sac", "sac": SACConfig(**SAC, sync_steps=4)},
    ),
}  # fmt: skip


def config(case: str, tmp_path: Path, cluster: str | None, **changes: Any) -> TrainConfig:
    target, of_case = CASES[case]
    settings: dict[str, Any] = {
        "num_worlds": 3, "num_engines": LAYOUTS[cluster], "seed": 7, "total_steps": 480,
        "runs": tmp_path, "evaluation_episodes": 4, "name": str(cluster), "cluster": cluster,
        "checkpoint_every_s": None, "checkpoint_every_updates": 2, "exact_resume": True,
        **of_case, **changes,
    }  # fmt: skip
    return TrainConfig(target=f"gym:tests.workers.environments:{target}", **settings)


@pytest.mark.parametrize("case", CASES)
def test_layouts_give_equal_checkpoints(
    case: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    use_in_process(monkeypatch)
    results = [train(config(case, tmp_path, cluster)) for cluster in LAYOUTS]
    alone, *others = [newest(result.path) for result in results]
    assert alone.run["updates"] >= 4
    for other in others:
        assert_equal(alone, other)
    for result in results:
        assert result.evaluation == results[0].evaluation
        assert result.mean_return == results[0].mean_return
