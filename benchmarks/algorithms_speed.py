"""How fast PPO and SAC are beside Stable-Baselines3, by steps and gradient updates per second."""

from __future__ import annotations

import statistics
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch
from algorithms_tasks import PPO_DEFAULTS, SAC_DEFAULTS, Task, our_run, save, their_model

from ludus.runs.metrics import read_metrics
from ludus.settings.train_config import PPOConfig, SACConfig

MEASURES = {
    "steps_per_s": "environment steps/s",
    "updates_per_s": "gradient steps/s",
    "learning_per_s": "gradient steps/s, learning alone",
}


@dataclass(frozen=True)
class Speed:
    """Measure gradient updates and environment steps per second.

    Attributes:
        rounds: Times that each case is measured; the median counts.
        threads: PyTorch threads of both, one table for each number.
        scale: Length of the runs; 0.1 is a quick look.
        out: Write all results to this JSON file.
    """

    rounds: int = 5
    threads: tuple[int, ...] = (1, 2)
    scale: float = 1.0
    out: Path | None = None


@dataclass(frozen=True)
class Rates:
    """What one run reached.

    Attributes:
        steps_per_s: Environment steps per second of training, all included.
        updates_per_s: Gradient steps per second of training, all included.
        learning_per_s: Gradient steps per second of learning alone; 0 where it was not measured.
    """

    steps_per_s: float
    updates_per_s: float
    learning_per_s: float = 0.0


def num_updates(task: Task) -> int:
    """Return how many gradient steps a run of ``task`` takes."""
    settings = task.settings
    if isinstance(settings, SACConfig):
        return task.total_steps - settings.learning_starts
    return task.total_steps * settings.epochs // settings.minibatch_size


def our_rates(task: Task, threads: int) -> Rates:
    """Train once and return how fast it went; start and checkpoints do not count."""
    with tempfile.TemporaryDirectory() as folder:
        result = our_run(task, 0, threads, Path(folder))
        lines = read_metrics(result.path / "metrics.jsonl")
    learning_s, wall_s = 0.0, 0.0
    for line in lines:
        learning_s += line["update_share"] * (line["wall_s"] - wall_s)
        wall_s = line["wall_s"]
    updates = num_updates(task)
    is_ppo = isinstance(task.settings, PPOConfig)
    alone = updates / learning_s if is_ppo else 0.0
    return Rates(result.agent_steps / result.wall_s, updates / result.wall_s, alone)


def their_rates(task: Task, threads: int) -> Rates:
    """Train once and return how fast it went; the start does not count."""
    torch.set_num_threads(threads)
    model = their_model(task, 0)
    learn, learning_s = model.train, 0.0

    def timed(*args: Any, **settings: Any) -> None:
        nonlocal learning_s
        start = time.perf_counter()
        learn(*args, **settings)
        learning_s += time.perf_counter() - start

    model.train = timed
    start = time.perf_counter()
    model.learn(task.total_steps)
    wall_s = time.perf_counter() - start
    updates = num_updates(task)
    is_ppo = isinstance(task.settings, PPOConfig)
    alone = updates / learning_s if is_ppo else 0.0
    return Rates(task.total_steps / wall_s, updates / wall_s, alone)


def speed_cases(scale: float) -> dict[str, Task]:
    """Return what is measured; lengths are whole rollouts."""
    sac = replace(SAC_DEFAULTS, learning_starts=100, report_steps=100)
    rollouts = max(1, round(4 * scale))
    steps = 100 * max(2, round(10 * scale))
    return {
        "SAC, Pendulum-v1, 1 environment": Task("Pendulum-v1", steps, steps, sac),
        "SAC, Hopper-v5, 1 environment": Task("Hopper-v5", steps, steps, sac),
        "PPO, CartPole-v1, 1 environment": Task(
            "CartPole-v1", 2048 * rollouts, 2048 * rollouts, PPO_DEFAULTS
        ),
        "PPO, CartPole-v1, 16 environments": Task(
            "CartPole-v1", 2048 * 16, 2048 * 16, PPO_DEFAULTS, num_envs=16
        ),
    }


def measure_speed(options: Speed) -> None:
    """Measure all cases and print a table."""
    results: list[dict[str, Any]] = []
    print("| case | threads | measure | Ludus | Stable-Baselines3 | ratio |")
    print("|---|---|---|---|---|---|")
    for threads in options.threads:
        for name, task in speed_cases(options.scale).items():
            ours: list[Rates] = []
            theirs: list[Rates] = []
            for _ in range(options.rounds):
                ours.append(our_rates(task, threads))
                theirs.append(their_rates(task, threads))
            for measure in ("steps_per_s", "updates_per_s", "learning_per_s"):
                one = statistics.median(getattr(rates, measure) for rates in ours)
                two = statistics.median(getattr(rates, measure) for rates in theirs)
                if one:
                    row = f"| {name} | {threads} | {MEASURES[measure]} | {one:,.0f} | {two:,.0f} "
                    print(f"{row}| {one / two:.2f} |", flush=True)
            results.append(
                {"case": name, "threads": threads, "ours": [vars(each) for each in ours],
                 "theirs": [vars(each) for each in theirs]}
            )  # fmt: skip
            save(options.out, {"speed": results})
