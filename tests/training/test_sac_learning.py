"""Whole runs of SAC: tasks are solved, values are what the arithmetic says, runs resume."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from ludus.errors import DivergenceError
from ludus.networks.networks import perceptron
from ludus.networks.tensors import load_tensors
from ludus.runs.checkpoint import Checkpoint, read_checkpoint
from ludus.runs.metrics import POLICY_METRICS, read_metrics
from ludus.runs.run_folder import RunFolder
from ludus.settings.train_config import SACConfig, TrainConfig
from ludus.training.loop import train

pytestmark = pytest.mark.slow


def config(target: str, tmp_path: Path, total_steps: int, **sac: Any) -> TrainConfig:
    settings: dict[str, Any] = {
        "hidden_sizes": (32,), "batch_size": 64, "learning_rate": 3e-3, "learning_starts": 200,
        "report_steps": 16, "replay_capacity": 20_000,
    }  # fmt: skip
    return TrainConfig(
        target=f"gym:{target}", num_worlds=4, num_engines=2, seed=3, total_steps=total_steps,
        runs=tmp_path, algorithm="sac", sac=SACConfig(**{**settings, **sac}),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("target", "total_steps", "at_least"),
    [
        ("Identity-discrete-v0", 2_500, 7.6),
        ("Identity-continuous-v0", 2_500, -0.8),
        ("Masked-v0", 2_500, 7.6),
        ("Pictures-v0", 1_500, 1.0),
    ],
)
def test_identity_is_solved(target: str, total_steps: int, at_least: float, tmp_path: Path) -> None:
    sac: dict[str, Any] = {"updates_per_step": 2.0, "discount": 0.5}
    if target == "Pictures-v0":
        sac = {"batch_size": 32, "learning_rate": 1e-3}
    result = train(config(target, tmp_path, total_steps, **sac))
    assert result.evaluation["agent"].num_episodes == 20
    assert result.evaluation["agent"].mean_return >= at_least


CONTROL: dict[str, Any] = {
    "hidden_sizes": (64, 64), "batch_size": 128, "learning_rate": 1e-3, "learning_starts": 400,
    "report_steps": 50,
}  # fmt: skip


@pytest.mark.training
def test_pendulum_swings_up(tmp_path: Path) -> None:
    """At random about -1200; a good policy gets -150."""
    sac = {**CONTROL, "updates_per_step": 8.0, "discount": 0.98}
    result = train(config("Pendulum-v1", tmp_path, 7_000, **sac))
    assert result.evaluation["agent"].mean_return >= -350.0


@pytest.mark.training
def test_cartpole_is_balanced(tmp_path: Path) -> None:
    """At random about 22 of 500."""
    result = train(config("CartPole-v1", tmp_path, 8_000, updates_per_step=4.0, **CONTROL))
    assert result.evaluation["agent"].mean_return >= 150.0


def value_of(target: str, share: float, tmp_path: Path) -> float:
    """Train with discount 0.9 and nearly no entropy; return the value of action 0 at ``share``."""
    settings = config(
        target, tmp_path, 4_000, discount=0.9, temperature=1e-6, target_rate=0.05,
        normalise_observation=False, updates_per_step=4.0, learning_rate_schedule="linear",
    )  # fmt: skip
    result = train(replace(settings, evaluation_episodes=0))
    _, checkpoint = RunFolder(result.path).checkpoints().newest()
    critic = perceptron((1, 32, 2), "relu", 1.0)
    load_tensors(critic, checkpoint.learners["agent"].tensors, "critic.first.")
    with torch.inference_mode():
        return float(critic(torch.tensor([[share]]))[0, 0])


@pytest.mark.training
def test_truncation_is_bootstrapped(tmp_path: Path) -> None:
    """An endless task cut every 5 steps is worth r / (1 - gamma) = 10."""
    assert value_of("Truncated-v0", 0.5, tmp_path) == pytest.approx(10.0, rel=0.03)


@pytest.mark.training
def test_termination_is_not_bootstrapped(tmp_path: Path) -> None:
    """Five steps are worth (1 - gamma^5) / (1 - gamma) = 4.0951."""
    assert value_of("Terminated-v0", 0.0, tmp_path) == pytest.approx(4.0951, rel=0.03)


# --- runs ----------------------------------------------------------------------------------------


def tiny(tmp_path: Path, target: str = "Identity-continuous-v0", **changes: Any) -> TrainConfig:
    sac: dict[str, Any] = {
        "learning_starts": 40, "report_steps": 8, "batch_size": 16, "updates_per_step": 0.7,
        "replay_capacity": 300,
    }  # fmt: skip
    settings = replace(
        config(target, tmp_path, 768, **{**sac, **changes.pop("sac", {})}),
        evaluation_episodes=0, checkpoint_every_s=None, checkpoint_every_updates=2, name="run",
    )  # fmt: skip
    return replace(settings, **changes)


def newest(run: Path) -> Checkpoint:
    return read_checkpoint(RunFolder(run).checkpoints().paths()[-1], has_replay=True)


@pytest.mark.parametrize("target", ["Identity-continuous-v0", "Masked-v0"])
def test_exact_resume_equals_an_uninterrupted_run(target: str, tmp_path: Path) -> None:
    whole = train(tiny(tmp_path, target, exact_resume=True, name="whole"))
    half = train(tiny(tmp_path, target, exact_resume=True, name="half", total_steps=384))
    assert half.agent_steps == 384
    train(tiny(tmp_path, target, exact_resume=True, name="half"), resume=half.path)
    one, two = (newest(run).learners["agent"] for run in (whole.path, half.path))
    assert one.values == two.values
    for first, second in ((one.tensors, two.tensors), (one.replay, two.replay)):
        assert first.keys() == second.keys()
        assert first
        assert all(torch.equal(first[name], second[name]) for name in first)


def test_metrics_are_documented_and_finite(tmp_path: Path) -> None:
    result = train(tiny(tmp_path))
    lines = read_metrics(result.path / "metrics.jsonl")
    last = lines[-1]["policies"]["agent"]
    assert last.keys() <= POLICY_METRICS.keys()
    of_sac = {name for name, text in POLICY_METRICS.items() if text.startswith("SAC")}
    assert of_sac <= last.keys()
    assert last["replay_size"] == 300


def test_divergence_names_the_policy(tmp_path: Path) -> None:
    with pytest.raises(DivergenceError, match=r"policy agent: q_loss is inf"):
        train(tiny(tmp_path, "Poisoned-v0"))
