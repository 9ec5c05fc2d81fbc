"""Settings of one policy: what every algorithm knows, and what only one of them does.

Scenes (``LudusPolicySettings``), files and the command line use the same names.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from ludus.settings.checks import (
    ABOVE_0,
    AT_LEAST_0,
    AT_LEAST_1,
    FROM_0_TO_1,
    Check,
    Settings,
    optional,
    require,
    setting,
)

__all__ = [
    "ALGORITHM_CONFIGS",
    "CHANGEABLE",
    "Activation",
    "Mode",
    "PPOConfig",
    "PolicyConfig",
    "SACConfig",
]

Activation = Literal["tanh", "relu", "elu", "silu"]

Mode = Literal["train", "frozen", "deterministic"]
"""``train`` learns; ``frozen`` acts as in training but learns nothing; ``deterministic`` takes the
most probable action and learns nothing."""


SIZES = Check("sizes of at least 1", lambda sizes: min(sizes or (1,)) >= 1)


@dataclass(frozen=True)
class PPOConfig(Settings):
    """Settings of one policy trained with PPO.

    Attributes:
        algorithm: Training algorithm.
        mode: train, frozen (acts as in training but learns nothing) or deterministic (takes the
            most probable actions and learns nothing).
        hidden_sizes: Units of each hidden layer of the actor.
        critic_hidden_sizes: Units of each hidden layer of the critic; hidden_sizes if not given.
        activation: Non-linearity between layers.
        frame_stack: Observations that the network sees together: the last ones of the episode.
        memory_size: Units of a recurrent layer (GRU) before the actor; 0 for none.
        sequence_length: Steps over which gradients flow back through the memory.
        learning_rate: Step size of Adam at the start.
        learning_rate_schedule: "linear" falls to zero at total_steps, "constant" stays the same.
        rollout_steps: Steps of every agent between two updates.
        minibatch_size: Transitions in one gradient step.
        epochs: Passes over the transitions of one rollout.
        overlap: Learn from one rollout while the next is collected; actions then come from a
            network that is one update older.
        discount: Gamma: how much a reward is worth one step earlier.
        gae_lambda: Lambda of generalised advantage estimation.
        clip_range: Epsilon of the clipped surrogate objective.
        value_clip_range: How far a value may move in one update; no limit if not given.
        value_coefficient: Weight of the value loss.
        entropy_coefficient: Weight of the entropy bonus.
        max_grad_norm: Gradients with a larger norm are scaled down to this one.
        target_kl: Stop the epochs of an update beyond this KL divergence; never if not given.
        normalise_advantage: Give the advantages of each minibatch mean 0 and standard deviation 1.
        normalise_observation: Shift and scale observations by running statistics.
        scale_reward: Divide rewards by the running standard deviation of the return.
        initial_log_std: Logarithm of the standard deviation of continuous actions at the start, for
            bounds of -1 and 1.
        state_dependent_std: Let the network output the standard deviation of continuous actions;
            otherwise it is the same in every state.
        squash: Keep continuous actions inside their bounds with tanh; otherwise they are clipped.
        curiosity: Weight of the reward for seeing something new (random network distillation); 0
            for none.
        curiosity_discount: Gamma of that reward, which does not end with an episode.
    """

    algorithm: Literal["ppo"] = "ppo"
    mode: Mode = "train"
    hidden_sizes: tuple[int, ...] = setting((64, 64), SIZES)
    critic_hidden_sizes: tuple[int, ...] | None = setting(None, SIZES)
    activation: Activation = "tanh"
    frame_stack: int = setting(1, AT_LEAST_1)
    memory_size: int = setting(0, AT_LEAST_0)
    sequence_length: int = setting(16, AT_LEAST_1)
    learning_rate: float = setting(1e-3, ABOVE_0)
    learning_rate_schedule: Literal["linear", "constant"] = "linear"
    rollout_steps: int = setting(32, AT_LEAST_1)
    minibatch_size: int = setting(1024, AT_LEAST_1)
    epochs: int = setting(4, AT_LEAST_1)
    overlap: bool = False
    discount: float = setting(0.99, FROM_0_TO_1)
    gae_lambda: float = setting(0.95, FROM_0_TO_1)
    clip_range: float = setting(0.2, ABOVE_0)
    value_clip_range: float | None = setting(None, optional(ABOVE_0))
    value_coefficient: float = 0.5
    entropy_coefficient: float = 0.01
    max_grad_norm: float = setting(0.5, ABOVE_0)
    target_kl: float | None = setting(None, optional(ABOVE_0))
    normalise_advantage: bool = True
    normalise_observation: bool = True
    scale_reward: bool = True
    initial_log_std: float = -0.5
    state_dependent_std: bool = False
    squash: bool = False
    curiosity: float = setting(0.0, AT_LEAST_0)
    curiosity_discount: float = setting(0.99, FROM_0_TO_1)

    def __post_init__(self) -> None:
        super().__post_init__()
        is_whole = self.rollout_steps % min(self.sequence_length, self.rollout_steps) == 0
        expected = f"a multiple of sequence_length ({self.sequence_length})"
        require(is_whole or not self.memory_size, "rollout_steps", expected, self.rollout_steps)


@dataclass(frozen=True)
class SACConfig(Settings):
    """Settings of one policy trained with SAC.

    Attributes:
        algorithm: Training algorithm.
        mode: train, frozen (acts as in training but learns nothing) or deterministic (takes the
            most probable actions and learns nothing).
        hidden_sizes: Units of each hidden layer of the actor.
        critic_hidden_sizes: Units of each hidden layer of the two critics; hidden_sizes if not
            given.
        activation: Non-linearity between layers.
        frame_stack: Observations that the networks see together: the last ones of the episode.
        learning_rate: Step size of Adam for actor, critics and temperature.
        learning_rate_schedule: "linear" falls to zero at total_steps, "constant" stays the same.
        batch_size: Transitions in one gradient step.
        replay_capacity: Newest transitions to keep, over all agents.
        save_replay: Save the replay in checkpoints; without it, a resumed run starts with an empty
            one.
        learning_starts: Random transitions to collect before learning begins.
        updates_per_step: Gradient steps for each step of all agents; below 1 learns every few
            steps.
        report_steps: Steps of every agent between two lines of metrics.
        sync_steps: Steps of every agent for which one version of the network acts. On a cluster, a
            higher number saves messages, but actions come from an older network.
        discount: Gamma: how much a reward is worth one step earlier.
        target_rate: Tau: share of the critics that their targets take over in each gradient step.
        temperature: Weight of the entropy; learned if not given.
        initial_temperature: Start value of a learned temperature.
        target_entropy: Entropy in nats that a learned temperature aims at; if not given, minus the
            number of continuous elements, or 0.7 of the highest entropy of a discrete choice.
        max_grad_norm: Gradients with a larger norm are scaled down to this one; no limit if not
            given.
        normalise_observation: Shift and scale observations by running statistics.
        reward_scale: Factor by which rewards are multiplied.
    """

    algorithm: Literal["sac"] = "sac"
    mode: Mode = "train"
    hidden_sizes: tuple[int, ...] = setting((256, 256), SIZES)
    critic_hidden_sizes: tuple[int, ...] | None = setting(None, SIZES)
    activation: Activation = "relu"
    frame_stack: int = setting(1, AT_LEAST_1)
    learning_rate: float = setting(3e-4, ABOVE_0)
    learning_rate_schedule: Literal["linear", "constant"] = "constant"
    batch_size: int = setting(256, AT_LEAST_1)
    replay_capacity: int = setting(100_000, AT_LEAST_1)
    save_replay: bool = True
    learning_starts: int = setting(1000, AT_LEAST_0)
    updates_per_step: float = setting(1.0, ABOVE_0)
    report_steps: int = setting(128, AT_LEAST_1)
    sync_steps: int = setting(1, AT_LEAST_1)
    discount: float = setting(0.99, FROM_0_TO_1)
    target_rate: float = setting(0.005, FROM_0_TO_1)
    temperature: float | None = setting(None, optional(ABOVE_0))
    initial_temperature: float = setting(1.0, ABOVE_0)
    target_entropy: float | None = None
    max_grad_norm: float | None = setting(None, optional(ABOVE_0))
    normalise_observation: bool = True
    reward_scale: float = setting(1.0, ABOVE_0)

    def __post_init__(self) -> None:
        super().__post_init__()
        expected = f"at least batch_size, {self.batch_size},"
        is_enough = self.replay_capacity >= self.batch_size
        require(is_enough, "replay_capacity", expected, self.replay_capacity)


PolicyConfig = PPOConfig | SACConfig
"""Settings of one policy, whatever its algorithm."""

ALGORITHM_CONFIGS: dict[str, type[PPOConfig] | type[SACConfig]] = {
    "ppo": PPOConfig,
    "sac": SACConfig,
}
"""Which settings an algorithm has."""

CHANGEABLE = frozenset({
    "mode", "learning_rate", "learning_rate_schedule", "minibatch_size", "epochs", "gae_lambda",
    "clip_range", "value_clip_range", "value_coefficient", "entropy_coefficient", "max_grad_norm",
    "target_kl", "normalise_advantage", "batch_size", "updates_per_step", "target_rate",
})  # fmt: skip
"""Settings that may change while a run goes on: no network, array or statistic depends on them."""
