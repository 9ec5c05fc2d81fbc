"""Settings of one policy: what every algorithm knows, and what only one of them does.

Scenes (``LudusPolicySettings``), files and the command line use the same names.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from ludus.errors import ConfigError

__all__ = [
    "ALGORITHM_CONFIGS",
    "Activation",
    "Mode",
    "PPOConfig",
    "PolicyConfig",
    "SACConfig",
    "require",
]

Activation = Literal["tanh", "relu", "elu", "silu"]

Mode = Literal["train", "frozen", "deterministic"]
"""``train`` learns; ``frozen`` acts as in training but learns nothing; ``deterministic`` takes the
most probable action and learns nothing."""


@dataclass(frozen=True)
class PPOConfig:
    """Settings of one policy trained with PPO.

    Attributes:
        algorithm: Training algorithm.
        mode: Whether it learns: train; frozen acts as in training but learns nothing;
            deterministic takes the most probable actions and learns nothing.
        hidden_sizes: Units of each hidden layer of the actor.
        critic_hidden_sizes: The same of the critic; none is hidden_sizes.
        activation: Non-linearity between layers.
        memory_size: Units of a recurrent layer (GRU) before the actor; 0 leaves it out.
        sequence_length: Steps that gradients go back through the memory.
        learning_rate: Step size of Adam, at the start.
        learning_rate_schedule: "linear" falls to zero at total_steps, "constant" stays.
        rollout_steps: Steps of every agent between two updates.
        minibatch_size: Transitions in one gradient step.
        epochs: Passes over the transitions of one rollout.
        overlap: Learn from one rollout while the next is collected; actions then come from a
            network that is one update older.
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
        state_dependent_std: Whether the network puts out the deviation of continuous actions;
            otherwise it is the same in every state.
        squash: Whether tanh keeps continuous actions inside their bounds; otherwise they are
            cut off there.
    """

    algorithm: Literal["ppo"] = "ppo"
    mode: Mode = "train"
    hidden_sizes: tuple[int, ...] = (64, 64)
    critic_hidden_sizes: tuple[int, ...] | None = None
    activation: Activation = "tanh"
    memory_size: int = 0
    sequence_length: int = 16
    learning_rate: float = 1e-3
    learning_rate_schedule: Literal["linear", "constant"] = "linear"
    rollout_steps: int = 32
    minibatch_size: int = 1024
    epochs: int = 4
    overlap: bool = False
    discount: float = 0.99
    gae_lambda: float = 0.95
    clip_range: float = 0.2
    value_clip_range: float | None = None
    value_coefficient: float = 0.5
    entropy_coefficient: float = 0.01
    max_grad_norm: float = 0.5
    target_kl: float | None = None
    normalise_advantage: bool = True
    normalise_observation: bool = True
    scale_reward: bool = True
    initial_log_std: float = -0.5
    state_dependent_std: bool = False
    squash: bool = False

    def __post_init__(self) -> None:
        _check_networks(self)
        _check_above_zero(self, "learning_rate", "clip_range", "max_grad_norm")
        _check_shares(self, "discount", "gae_lambda")
        _check_counts(self, "rollout_steps", "minibatch_size", "epochs", "sequence_length")
        _check_optional(self, "value_clip_range", "target_kl")
        require(self.memory_size >= 0, "memory_size", "at least 0", self.memory_size)
        is_whole = self.rollout_steps % min(self.sequence_length, self.rollout_steps) == 0
        expected = f"a multiple of sequence_length, {self.sequence_length},"
        require(is_whole or not self.memory_size, "rollout_steps", expected, self.rollout_steps)


@dataclass(frozen=True)
class SACConfig:
    """Settings of one policy trained with SAC.

    Attributes:
        algorithm: Training algorithm.
        mode: Whether it learns: train; frozen acts as in training but learns nothing;
            deterministic takes the most probable actions and learns nothing.
        hidden_sizes: Units of each hidden layer of the actor.
        critic_hidden_sizes: The same of the two critics; none is hidden_sizes.
        activation: Non-linearity between layers.
        learning_rate: Step size of Adam for actor, critics and temperature.
        learning_rate_schedule: "linear" falls to zero at total_steps, "constant" stays.
        batch_size: Transitions in one gradient step.
        replay_capacity: Newest transitions to keep, over all agents.
        save_replay: Whether checkpoints hold the replay; without it, resuming begins with none.
        learning_starts: Transitions, acted at random, before learning begins.
        updates_per_step: Gradient steps for each step of all agents; below 1 learns every few
            steps.
        report_steps: Steps of every agent between two lines of metrics.
        discount: Gamma; worth of a reward one step later.
        target_rate: Tau; share of the critics that their targets take over after each step.
        temperature: Weight of the entropy; none learns it.
        initial_temperature: Where a learned temperature begins.
        target_entropy: Entropy that a learned temperature aims at, nats; none is minus the number
            of continuous elements, or 0.7 of the highest entropy of a discrete choice.
        max_grad_norm: Gradients longer than this are shortened to it; none leaves them.
        normalise_observation: Whether observations are shifted and scaled by running statistics.
        reward_scale: Rewards are multiplied by this.
    """

    algorithm: Literal["sac"] = "sac"
    mode: Mode = "train"
    hidden_sizes: tuple[int, ...] = (256, 256)
    critic_hidden_sizes: tuple[int, ...] | None = None
    activation: Activation = "relu"
    learning_rate: float = 3e-4
    learning_rate_schedule: Literal["linear", "constant"] = "constant"
    batch_size: int = 256
    replay_capacity: int = 100_000
    save_replay: bool = True
    learning_starts: int = 1000
    updates_per_step: float = 1.0
    report_steps: int = 128
    discount: float = 0.99
    target_rate: float = 0.005
    temperature: float | None = None
    initial_temperature: float = 1.0
    target_entropy: float | None = None
    max_grad_norm: float | None = None
    normalise_observation: bool = True
    reward_scale: float = 1.0

    def __post_init__(self) -> None:
        _check_networks(self)
        _check_above_zero(self, "learning_rate", "updates_per_step", "initial_temperature",
                          "reward_scale")  # fmt: skip
        _check_shares(self, "discount", "target_rate")
        _check_counts(self, "batch_size", "replay_capacity", "report_steps")
        _check_optional(self, "temperature", "max_grad_norm")
        require(self.learning_starts >= 0, "learning_starts", "at least 0", self.learning_starts)
        require(self.replay_capacity >= self.batch_size, "replay_capacity",
                f"at least batch_size, {self.batch_size},", self.replay_capacity)  # fmt: skip


PolicyConfig = PPOConfig | SACConfig
"""Settings of one policy, whatever its algorithm."""

ALGORITHM_CONFIGS: dict[str, type[PPOConfig] | type[SACConfig]] = {
    "ppo": PPOConfig,
    "sac": SACConfig,
}
"""Which settings an algorithm has."""


def require(is_met: bool, name: str, expected: str, value: object) -> None:
    """Raise a ``ConfigError`` about a setting unless ``is_met``."""
    if not is_met:
        raise ConfigError(f"{name} must be {expected}, not {value!r}")


def _check_networks(config: PolicyConfig) -> None:
    for name in ("hidden_sizes", "critic_hidden_sizes"):
        sizes: tuple[int, ...] | None = getattr(config, name)
        require(min(sizes or (1,)) >= 1, name, "sizes of at least 1", sizes)


def _check_above_zero(config: PolicyConfig, *names: str) -> None:
    for name in names:
        require(getattr(config, name) > 0, name, "above 0", getattr(config, name))


def _check_shares(config: PolicyConfig, *names: str) -> None:
    for name in names:
        require(0 <= getattr(config, name) <= 1, name, "from 0 to 1", getattr(config, name))


def _check_counts(config: PolicyConfig, *names: str) -> None:
    for name in names:
        require(getattr(config, name) >= 1, name, "at least 1", getattr(config, name))


def _check_optional(config: PolicyConfig, *names: str) -> None:
    for name in names:
        value = getattr(config, name)
        require(value is None or value > 0, name, "above 0 or none", value)
