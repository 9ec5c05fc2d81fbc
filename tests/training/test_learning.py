"""Identity environments are solved, and values are what the arithmetic says."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from ludus.networks.networks import perceptron
from ludus.networks.tensors import load_tensors
from ludus.runs.run_folder import RunFolder
from ludus.settings.train_config import PPOConfig, SACConfig, TrainConfig
from ludus.training.loop import train

pytestmark = pytest.mark.slow


def config(target: str, tmp_path: Path, total_steps: int, **ppo: Any) -> TrainConfig:
    settings: dict[str, Any] = {"hidden_sizes": (32,), "minibatch_size": 128, "rollout_steps": 16}
    return TrainConfig(
        target=f"gym:{target}", num_worlds=8, num_engines=2, seed=3, total_steps=total_steps,
        runs=tmp_path, ppo=PPOConfig(**{**settings, **ppo}),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("target", "total_steps", "at_least"),
    [
        ("Identity-discrete-v0", 8_000, 7.6),
        ("Identity-multi_discrete-v0", 8_000, 7.6),
        ("Identity-continuous-v0", 25_000, -0.8),
        ("Masked-v0", 8_000, 7.6),
        ("Pictures-v0", 4_000, 1.0),
    ],
)
def test_identity_is_solved(target: str, total_steps: int, at_least: float, tmp_path: Path) -> None:
    ppo = {"learning_rate": 3e-3} if target != "Pictures-v0" else {}
    result = train(config(target, tmp_path, total_steps, **ppo))
    assert result.evaluation["agent"].num_episodes == 20
    assert result.evaluation["agent"].mean_return >= at_least


@pytest.mark.training
@pytest.mark.parametrize(
    "ppo",
    [
        {"squash": True},
        {"state_dependent_std": True},
        {"squash": True, "state_dependent_std": True},
    ],
    ids=["squashed", "state-dependent", "both"],
)
def test_every_kind_of_gaussian_learns(ppo: dict[str, Any], tmp_path: Path) -> None:
    result = train(config("Identity-continuous-v0", tmp_path, 25_000, learning_rate=3e-3, **ppo))
    assert result.evaluation["agent"].mean_return >= -0.8


@pytest.mark.training
def test_overlapped_learning_learns_as_well(tmp_path: Path) -> None:
    result = train(
        config("Identity-discrete-v0", tmp_path, 10_000, learning_rate=3e-3, overlap=True)
    )
    assert result.evaluation["agent"].mean_return >= 7.6


@pytest.mark.training
def test_only_a_memory_recalls(tmp_path: Path) -> None:
    """The cue of the first step pays at the last one: by chance a quarter, with memory all."""
    ppo = {"learning_rate": 3e-3, "discount": 0.9}
    without = train(config("Recall-v0", tmp_path, 4_000, **ppo))
    assert without.evaluation["agent"].mean_return < 0.7
    memory = {"memory_size": 16, "sequence_length": 8}
    recalled = train(config("Recall-v0", tmp_path, 30_000, **ppo, **memory))
    assert recalled.evaluation["agent"].mean_return >= 0.95


@pytest.mark.training
@pytest.mark.parametrize("algorithm", ["ppo", "sac"])
def test_only_several_frames_show_what_moves(algorithm: str, tmp_path: Path) -> None:
    """Of an episode of five steps four pay; without the frame before, half of those at best."""
    for frame_stack, low, high in ((1, 1.0, 2.8), (2, 3.6, 4.0)):
        settings: dict[str, Any] = {"frame_stack": frame_stack, "learning_rate": 3e-3}
        if algorithm == "sac":
            made = config("Direction-v0", tmp_path, 6_000)
            sac = SACConfig(
                **settings, hidden_sizes=(32, 32), learning_starts=200, updates_per_step=2.0
            )
            made = replace(made, algorithm="sac", sac=sac)
        else:
            made = config("Direction-v0", tmp_path, 12_000, **settings)
        assert low <= train(made).evaluation["agent"].mean_return <= high


@pytest.mark.training
def test_only_curiosity_climbs_to_a_reward_that_chance_does_not_reach(tmp_path: Path) -> None:
    ppo = {"rollout_steps": 32, "learning_rate": 3e-3}
    plain = train(config("Stairs-v0", tmp_path, 20_000, **ppo))
    assert plain.evaluation["agent"].mean_return == 0.0
    curiosity = {"curiosity": 1.0, "curiosity_discount": 0.9}
    curious = train(config("Stairs-v0", tmp_path, 60_000, **ppo, **curiosity))
    assert curious.evaluation["agent"].mean_return == 1.0


def value_of(target: str, share: float, tmp_path: Path) -> float:
    """Train with discount 0.9 and return the value of the observation ``share``."""
    settings = config(
        target, tmp_path, 25_000, discount=0.9, scale_reward=False, normalise_observation=False,
        learning_rate=5e-3, max_grad_norm=100.0,
    )  # fmt: skip
    result = train(settings)
    _, checkpoint = RunFolder(result.path).checkpoints().newest()
    critic = perceptron((1, 32, 1), "tanh", 1.0)
    load_tensors(critic, checkpoint.learners["agent"].tensors, "critic.")
    with torch.inference_mode():
        return float(critic(torch.tensor([[share]])))


@pytest.mark.training
def test_truncation_is_bootstrapped(tmp_path: Path) -> None:
    """An endless task cut every 5 steps is worth r / (1 - gamma) = 10."""
    assert value_of("Truncated-v0", 0.5, tmp_path) == pytest.approx(10.0, rel=0.03)


@pytest.mark.training
def test_termination_is_not_bootstrapped(tmp_path: Path) -> None:
    """Five steps are worth (1 - gamma^5) / (1 - gamma) = 4.0951."""
    assert value_of("Terminated-v0", 0.0, tmp_path) == pytest.approx(4.0951, rel=0.03)
