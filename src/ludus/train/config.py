"""What a training run can be told: one struct = command line = TOML file = scene settings.

How the layers are laid over each other is the business of :mod:`ludus.train.layers`.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from ludus.errors import ConfigError

__all__ = ["PPOConfig", "TrainConfig"]


@dataclass(frozen=True)
class PPOConfig:
    """Settings of one policy trained with PPO; scenes use the same names.

    Attributes:
        algorithm: Training algorithm.
        hidden_sizes: Units of each hidden layer, of the actor and of the critic.
        activation: Non-linearity between layers.
        learning_rate: Step size of Adam, at the start.
        learning_rate_schedule: "linear" falls to zero at total_steps, "constant" stays.
        rollout_steps: Steps of every agent between two updates.
        minibatch_size: Transitions in one gradient step.
        epochs: Passes over the transitions of one rollout.
        discount: Gamma; worth of a reward one step later.
        gae_lambda: Lambda of generalised advantage estimation.
        clip_range: Epsilon of the clipped surrogate objective.
        value_clip_range: How far a value may move in one update; none does not clip.
        value_coefficient: Weight of the value loss.
        entropy_coefficient: Weight of the entropy bonus.
        max_grad_norm: Gradients longer than this are shortened to it.
        target_kl: Stop an update's epochs beyond this divergence; none never stops.
        normalise_advantage: Whether each minibatch's advantages get mean 0 and deviation 1.
        normalise_observation: Whether observations are shifted and scaled by running statistics.
        scale_reward: Whether rewards are divided by the running deviation of the return.
        initial_log_std: Logarithm of the deviation of continuous actions, at the start, where
            the bounds are -1 and 1.
    """

    algorithm: Literal["ppo"] = "ppo"
    hidden_sizes: tuple[int, ...] = (64, 64)
    activation: Literal["tanh", "relu", "elu", "silu"] = "tanh"
    learning_rate: float = 1e-3
    learning_rate_schedule: Literal["linear", "constant"] = "linear"
    rollout_steps: int = 32
    minibatch_size: int = 1024
    epochs: int = 4
    discount: float = 0.99
    gae_lambda: float = 0.95
    clip_range: float = 0.2
    value_clip_range: float | None = None
    value_coefficient: float = 0.5
    entropy_coefficient: float = 0.0
    max_grad_norm: float = 0.5
    target_kl: float | None = None
    normalise_advantage: bool = True
    normalise_observation: bool = True
    scale_reward: bool = True
    initial_log_std: float = -0.5

    def __post_init__(self) -> None:
        for name in ("rollout_steps", "minibatch_size", "epochs"):
            _require(getattr(self, name) >= 1, name, "at least 1", getattr(self, name))
        for name in ("learning_rate", "clip_range", "max_grad_norm"):
            _require(getattr(self, name) > 0, name, "above 0", getattr(self, name))
        for name in ("discount", "gae_lambda"):
            _require(0 <= getattr(self, name) <= 1, name, "from 0 to 1", getattr(self, name))
        for name in ("value_clip_range", "target_kl"):
            value = getattr(self, name)
            _require(value is None or value > 0, name, "above 0 or none", value)
        _require(min(self.hidden_sizes, default=1) >= 1, "hidden_sizes", "sizes of at least 1",
                 self.hidden_sizes)  # fmt: skip


@dataclass(frozen=True)
class TrainConfig:
    """Settings of a training run.

    Attributes:
        target: What to train in: an example, a project folder, a scene, an exported game, an
            address, or gym:ENV_ID for any Gymnasium environment.
        scene: Scene of the project, res://…; none is the project's own.
        num_worlds: Worlds in each engine.
        num_engines: Game processes side by side.
        layout: "scene" is what the scene asks for; "isolated" gives each world its own physics
            space, "grid" puts all into one.
        ticks_per_step: Physics ticks per decision; none is what the agents say.
        max_episode_steps: Steps after which episodes are truncated; none is what the agents say.
        godot: Engine to use; none finds one.
        max_restarts: How often, in all, an engine that died or froze is started again.
        seed: Seed of worlds, networks and sampling; none draws one, and notes it.
        total_steps: Agent steps after which training ends.
        max_time_s: Seconds of training after which it ends; none is no limit.
        target_return: Training ends when every policy's mean return reaches it; none never.
        return_window: Episodes that the mean return is taken over.
        checkpoint_every_s: Seconds between checkpoints; none leaves it to checkpoint_every_updates.
        checkpoint_every_updates: Updates between checkpoints; none leaves it to checkpoint_every_s.
        keep_checkpoints: Newest checkpoints to keep; the best one is kept besides.
        exact_resume: Reset all worlds after each checkpoint, so that a resumed run repeats an
            uninterrupted one to the bit where the engine is deterministic. Cuts episodes short,
            and needs checkpoint_every_updates, as clocks are not deterministic.
        evaluation_episodes: Episodes of the evaluation at the end; 0 leaves it out.
        runs: Folder that run folders are made in.
        name: Name of the run folder; empty makes one from target, date and time.
        device: PyTorch device of networks and updates, such as cpu or cuda.
        torch_threads: Threads PyTorch may use; engines need the other cores.
        ppo: Settings of every policy.
        policies: Settings of single policies by name, over those in ppo.
    """

    target: str = ""
    scene: str | None = None
    num_worlds: int = 64
    num_engines: int = 2
    layout: Literal["scene", "isolated", "grid"] = "scene"
    ticks_per_step: int | None = None
    max_episode_steps: int | None = None
    godot: Path | None = None
    max_restarts: int = 3
    seed: int | None = None
    total_steps: int = 2_000_000
    max_time_s: float | None = None
    target_return: float | None = None
    return_window: int = 100
    checkpoint_every_s: float | None = 15.0
    checkpoint_every_updates: int | None = None
    keep_checkpoints: int = 3
    exact_resume: bool = False
    evaluation_episodes: int = 20
    runs: Path = Path("runs")
    name: str = ""
    device: str = "cpu"
    torch_threads: int = 1
    ppo: PPOConfig = field(default_factory=PPOConfig)
    policies: dict[str, PPOConfig] = field(default_factory=dict[str, PPOConfig])

    def __post_init__(self) -> None:
        for name in ("num_worlds", "num_engines", "total_steps", "return_window",
                     "keep_checkpoints", "torch_threads"):  # fmt: skip
            _require(getattr(self, name) >= 1, name, "at least 1", getattr(self, name))
        for name in ("ticks_per_step", "max_episode_steps", "checkpoint_every_updates"):
            value = getattr(self, name)
            _require(value is None or value >= 1, name, "at least 1 or none", value)
        for name in ("max_time_s", "checkpoint_every_s"):
            value = getattr(self, name)
            _require(value is None or value > 0, name, "above 0 or none", value)
        _require(self.evaluation_episodes >= 0, "evaluation_episodes", "at least 0",
                 self.evaluation_episodes)  # fmt: skip
        _require(self.seed is None or 0 <= self.seed < 2**63, "seed", "from 0 to 2^63 - 1",
                 self.seed)  # fmt: skip
        _require(re.fullmatch(r"[^/\\\0]*", self.name) is not None and self.name not in {".", ".."},
                 "name", "a folder name", self.name)  # fmt: skip
        self._check_exact_resume()

    def _check_exact_resume(self) -> None:
        if self.exact_resume and (
            self.checkpoint_every_s is not None or self.checkpoint_every_updates is None
        ):
            raise ConfigError(
                "exact_resume needs checkpoints at fixed updates, not at times of the clock",
                "set checkpoint_every_s to none and checkpoint_every_updates to a number",
            )


def _require(is_met: bool, name: str, expected: str, value: object) -> None:
    if not is_met:
        raise ConfigError(f"{name} must be {expected}, not {value!r}")
