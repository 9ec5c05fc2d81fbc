"""Learning curves of PPO and SAC beside those of Stable-Baselines3, at equal steps."""

from __future__ import annotations

import importlib
import statistics
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from algorithms_tasks import TASKS, Task, our_run, save, their_model

from ludus.play.evaluation import evaluate
from ludus.play.players import load_player
from ludus.pool import PoolConfig, open_pool
from ludus.runs.checkpoint import read_checkpoint

Curve = dict[int, float]
"""Mean return of an evaluation, by agent steps."""


@dataclass(frozen=True)
class Curves:
    """Train with several seeds, and evaluate at equal steps.

    Attributes:
        task: What to train.
        seeds: Number of seeds.
        first_seed: The first of them; the others follow.
        episodes: Episodes of each evaluation, most probable actions.
        threads: PyTorch threads.
        scale: Length of the runs.
        out: Write all results to this JSON file, after each run.
    """

    task: str
    seeds: int = 5
    first_seed: int = 0
    episodes: int = 10
    threads: int = 1
    scale: float = 1.0
    out: Path | None = None


def our_curve(task: Task, seed: int, options: Curves) -> tuple[Curve, float]:
    """Train, then evaluate every checkpoint; return the curve and the seconds of training."""
    pool = open_pool(f"gym:{task.env_id}", PoolConfig(num_worlds=options.episodes))
    with tempfile.TemporaryDirectory() as folder:
        result = our_run(task, seed, options.threads, Path(folder))
        curve: Curve = {}
        for path in sorted((result.path / "checkpoints").glob("step-*")):
            steps = read_checkpoint(path).agent_steps
            act = load_player([path], pool, seed=99)
            curve[steps] = evaluate(act, pool, options.episodes, seed=99)["agent"].mean_return
    pool.close()
    return dict(sorted(curve.items())), result.wall_s


def their_curve(task: Task, seed: int, options: Curves) -> tuple[Curve, float]:
    """Train, evaluating on the way; return the curve and the seconds of training."""
    torch.set_num_threads(options.threads)
    play = importlib.import_module("stable_baselines3.common.evaluation").evaluate_policy
    make_envs = importlib.import_module("stable_baselines3.common.env_util").make_vec_env
    base: Any = importlib.import_module("stable_baselines3.common.callbacks").BaseCallback
    envs = make_envs(task.env_id, n_envs=options.episodes, seed=99)
    model = their_model(task, seed)
    curve: Curve = {}
    evaluating_s = 0.0

    def look() -> None:
        nonlocal evaluating_s
        steps = int(model.num_timesteps)
        if steps < len(curve) * task.evaluate_every:
            return
        start = time.perf_counter()
        envs.seed(99)
        curve[steps] = float(play(model, envs, options.episodes, deterministic=True)[0])
        evaluating_s += time.perf_counter() - start

    def on_step(_: Any) -> bool:
        return True

    def on_rollout_start(_: Any) -> None:
        look()

    members = {"_on_step": on_step, "_on_rollout_start": on_rollout_start}
    callback = type("Look", (base,), members)()
    start = time.perf_counter()
    model.learn(task.total_steps, callback=callback)
    look()
    wall_s = time.perf_counter() - start - evaluating_s
    envs.close()
    return curve, wall_s


def measure_curves(options: Curves) -> None:
    """Train with all seeds, ours and theirs in turn, and print a table."""
    task = TASKS[options.task]
    steps = task.evaluate_every * max(1, round(task.total_steps * options.scale
                                               / task.evaluate_every))  # fmt: skip
    task = replace(task, total_steps=steps)
    sides: dict[str, Callable[[Task, int, Curves], tuple[Curve, float]]] = {"Ludus": our_curve}
    if task.has_peer:
        sides["Stable-Baselines3"] = their_curve
    runs: list[dict[str, Any]] = []
    for seed in range(options.first_seed, options.first_seed + options.seeds):
        for side, run in sides.items():
            curve, wall_s = run(task, seed, options)
            runs.append({"side": side, "seed": seed, "wall_s": wall_s, "curve": curve})
            save(options.out, {"task": options.task, "runs": runs})
            last = list(curve.values())[-1]
            print(f"{side} seed {seed}: {last:.1f} after {wall_s:.0f} s", flush=True)
    print("\n| task | side | return at the end | mean of the curve | training, s |")
    print("|---|---|---|---|---|")
    for side in sides:
        print(summary(options.task, side, [run for run in runs if run["side"] == side]))


def summary(task: str, side: str, runs: list[dict[str, Any]]) -> str:
    """Return one line of the table: mean ± deviation over seeds."""
    curves = [list(run["curve"].values()) for run in runs]
    last, whole = [curve[-1] for curve in curves], [float(np.mean(curve[1:])) for curve in curves]
    wall_s = statistics.median(run["wall_s"] for run in runs)
    return (
        f"| {task} | {side} | {np.mean(last):.1f} ± {np.std(last):.1f} "
        f"| {np.mean(whole):.1f} ± {np.std(whole):.1f} | {wall_s:.0f} |"
    )
