"""Compare PPO and SAC with Stable-Baselines3: same tasks, same hyperparameters, one process.

Stable-Baselines3 and MuJoCo are no dependencies of Ludus. Put them beside it, with the PyTorch and
Gymnasium that Ludus uses::

    uv pip install --target /tmp/sb3 --no-deps "stable-baselines3>=2,<3" pandas python-dateutil \
        pytz six mujoco mujoco-core etils absl-py glfw pyopengl fsspec importlib_resources zipp
    PYTHONPATH=/tmp/sb3 python benchmarks/algorithms.py speed
    PYTHONPATH=/tmp/sb3 python benchmarks/algorithms.py curves --task pendulum-sac --seeds 5

``speed`` needs a quiet machine; ours and theirs take turns, and medians count.
"""

from __future__ import annotations

import importlib
import json
import statistics
import tempfile
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch
import tyro

from ludus.pool.gymnasium_pool import GymnasiumPool
from ludus.train.checkpoint import read_checkpoint
from ludus.train.config import PPOConfig, SACConfig, TrainConfig
from ludus.train.evaluation import evaluate
from ludus.train.loop import train
from ludus.train.metrics import read_metrics
from ludus.train.progress import RunResult
from ludus.train.saved import load_policies

PPO_DEFAULTS = PPOConfig(
    hidden_sizes=(64, 64), activation="tanh", learning_rate=3e-4, rollout_steps=2048,
    learning_rate_schedule="constant", minibatch_size=64, epochs=10, initial_log_std=0.0,
    value_coefficient=1.0, normalise_observation=False, scale_reward=False,
)  # fmt: skip
"""Those of Stable-Baselines3. Its value loss lacks our factor 1/2, hence the coefficient."""

SAC_DEFAULTS = SACConfig(
    hidden_sizes=(256, 256), batch_size=256, replay_capacity=100_000, learning_starts=1000,
    normalise_observation=False, save_replay=False, report_steps=1000,
)  # fmt: skip


@dataclass(frozen=True)
class Task:
    """What both sides train on.

    Attributes:
        env_id: Gymnasium's name.
        total_steps: Length of a run.
        evaluate_every: Steps between two evaluations; a whole number of updates.
        settings: Of ours; theirs are derived from it.
        num_envs: Environments side by side.
        has_peer: Whether Stable-Baselines3 can do it.
    """

    env_id: str
    total_steps: int
    evaluate_every: int
    settings: PPOConfig | SACConfig
    num_envs: int = 1
    has_peer: bool = True

    @property
    def steps_per_update(self) -> int:
        """Agent steps between two updates, or two reports."""
        settings = self.settings
        is_ppo = isinstance(settings, PPOConfig)
        return self.num_envs * (settings.rollout_steps if is_ppo else settings.report_steps)


TASKS = {
    "cartpole-ppo": Task("CartPole-v1", 51_200, 4096, PPO_DEFAULTS),
    "cartpole-sac": Task("CartPole-v1", 20_000, 1000, SAC_DEFAULTS, has_peer=False),
    "pendulum-ppo": Task(
        "Pendulum-v1", 102_400, 8192,
        replace(PPO_DEFAULTS, rollout_steps=1024, learning_rate=1e-3, discount=0.9), num_envs=4,
    ),
    "pendulum-sac": Task("Pendulum-v1", 10_000, 1000, replace(SAC_DEFAULTS, learning_rate=1e-3)),
    "hopper-ppo": Task("Hopper-v5", 102_400, 8192, PPO_DEFAULTS),
    "hopper-sac": Task("Hopper-v5", 100_000, 5000, SAC_DEFAULTS),
}  # fmt: skip


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


# --- one run ------------------------------------------------------------------------------------


def our_run(task: Task, seed: int, threads: int, folder: Path) -> RunResult:
    """Train; a checkpoint at each multiple of ``evaluate_every`` steps."""
    settings = task.settings
    algorithm: dict[str, Any] = {settings.algorithm: settings}
    config = TrainConfig(
        target=f"gym:{task.env_id}", num_worlds=task.num_envs, num_engines=1, seed=seed,
        total_steps=task.total_steps, evaluation_episodes=0, runs=folder, device="cpu",
        checkpoint_every_s=None, keep_checkpoints=1_000_000, torch_threads=threads,
        checkpoint_every_updates=task.evaluate_every // task.steps_per_update,
        algorithm=settings.algorithm, **algorithm,
    )  # fmt: skip
    return train(config)


def their_model(task: Task, seed: int) -> Any:
    """Return a model of Stable-Baselines3 with the settings of ``task``."""
    sb3 = importlib.import_module("stable_baselines3")
    make_envs = importlib.import_module("stable_baselines3.common.env_util").make_vec_env
    envs = make_envs(task.env_id, n_envs=task.num_envs, seed=seed)
    settings = task.settings
    activations = {"tanh": torch.nn.Tanh, "relu": torch.nn.ReLU}
    network: dict[str, Any] = {
        "net_arch": list(settings.hidden_sizes),
        "activation_fn": activations[settings.activation],
    }
    common: dict[str, Any] = {
        "env": envs, "seed": seed, "device": "cpu", "learning_rate": settings.learning_rate,
        "gamma": settings.discount,
    }  # fmt: skip
    if isinstance(settings, SACConfig):
        return sb3.SAC(
            "MlpPolicy", **common, policy_kwargs=network, batch_size=settings.batch_size,
            buffer_size=settings.replay_capacity, learning_starts=settings.learning_starts,
            tau=settings.target_rate, train_freq=1,
            gradient_steps=round(settings.updates_per_step),
        )  # fmt: skip
    network["log_std_init"] = settings.initial_log_std
    return sb3.PPO(
        "MlpPolicy", **common, policy_kwargs=network, n_steps=settings.rollout_steps,
        batch_size=settings.minibatch_size, n_epochs=settings.epochs,
        gae_lambda=settings.gae_lambda, clip_range=settings.clip_range,
        ent_coef=settings.entropy_coefficient, vf_coef=settings.value_coefficient / 2,
        max_grad_norm=settings.max_grad_norm, normalize_advantage=settings.normalise_advantage,
    )  # fmt: skip


# --- speed --------------------------------------------------------------------------------------


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
        lines = read_metrics(result.run / "metrics.jsonl")
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


MEASURES = {
    "steps_per_s": "environment steps/s",
    "updates_per_s": "gradient steps/s",
    "learning_per_s": "gradient steps/s, learning alone",
}


# --- learning curves ----------------------------------------------------------------------------

Curve = dict[int, float]
"""Mean return of an evaluation, by agent steps."""


def our_curve(task: Task, seed: int, options: Curves) -> tuple[Curve, float]:
    """Train, then evaluate every checkpoint; return the curve and the seconds of training."""
    pool = GymnasiumPool(task.env_id, num_worlds=options.episodes)
    with tempfile.TemporaryDirectory() as folder:
        result = our_run(task, seed, options.threads, Path(folder))
        curve: Curve = {}
        for path in sorted((result.run / "checkpoints").glob("step-*")):
            steps = read_checkpoint(path).agent_steps
            policies = load_policies(path, pool.policies)
            curve[steps] = evaluate(policies, pool, options.episodes, seed=99)["agent"].mean_return
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


def save(path: Path | None, results: dict[str, Any]) -> None:
    """Write results, if they are wanted."""
    if path is not None:
        path.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")


def main(
    options: Annotated[Speed, tyro.conf.subcommand("speed")]
    | Annotated[Curves, tyro.conf.subcommand("curves")],
) -> None:
    """Measure what the command line says."""
    warnings.filterwarnings("ignore", module="stable_baselines3")
    if isinstance(options, Speed):
        measure_speed(options)
    else:
        measure_curves(options)


if __name__ == "__main__":
    tyro.cli(main, config=(tyro.conf.OmitArgPrefixes, tyro.conf.OmitSubcommandPrefixes))
