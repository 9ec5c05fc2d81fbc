"""The tasks that both sides train on, and one run of each side."""

from __future__ import annotations

import importlib
import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch

from ludus.settings.train_config import PPOConfig, SACConfig, TrainConfig
from ludus.training.loop import train
from ludus.training.progress import RunResult

PPO_DEFAULTS = PPOConfig(
    hidden_sizes=(64, 64), activation="tanh", learning_rate=3e-4, rollout_steps=2048,
    learning_rate_schedule="constant", minibatch_size=64, epochs=10, initial_log_std=0.0,
    value_coefficient=1.0, entropy_coefficient=0.0, normalise_observation=False,
    scale_reward=False,
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


def save(path: Path | None, results: dict[str, Any]) -> None:
    """Write results, if they are wanted."""
    if path is not None:
        path.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
