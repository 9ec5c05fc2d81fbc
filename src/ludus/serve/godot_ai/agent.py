"""One agent: SAC over one vector, fed with transitions and told when to learn."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from numpy.typing import NDArray

from ludus.algorithms.learner import LearnerSettings
from ludus.algorithms.learners import policy_seed
from ludus.algorithms.replay import Sample
from ludus.algorithms.sac import LOSS_METRICS, MAX_STEPS_AT_ONCE, SAC
from ludus.errors import CheckpointError, ConfigError
from ludus.export.godot_ai_file import STATE, GodotAiCheckpoint, godot_ai_spec
from ludus.networks.policy import Policy
from ludus.networks.tensors import as_tensor
from ludus.settings.train_config import SACConfig
from ludus.spec import PolicySpec

__all__ = ["ENTRY", "Agent", "AgentSettings"]

ENTRY = STATE
"""The one entry of what an agent observes."""

MAX_REPLAY_BYTES = 16 << 30
MAX_PARAMETERS = 100_000_000


@dataclass(frozen=True)
class AgentSettings:
    """What a game says of an agent in ``init``.

    Attributes:
        name: ``file_name``.
        state_size: ``state_dim``, numbers that it observes.
        action_size: ``action_dim``, numbers in [-1, 1] that it does.
        batch_size: ``batchsize``, transitions in one gradient step.
        hidden_size: Units of each hidden layer.
        num_actor_layers: Hidden layers of the actor after the first.
        num_critic_layers: The same of the critics.
        replay_capacity: Newest transitions to keep.
    """

    name: str
    state_size: int
    action_size: int
    batch_size: int
    hidden_size: int
    num_actor_layers: int
    num_critic_layers: int
    replay_capacity: int

    def __post_init__(self) -> None:
        num_bytes = 4 * (2 * self.state_size + self.action_size + 2) * self.replay_capacity
        if num_bytes > MAX_REPLAY_BYTES:
            raise ConfigError(
                f"agent {self.name}: {self.replay_capacity} replays of {self.state_size} numbers "
                f"take {num_bytes / 1e9:.0f} GB",
                f"lower get_replay_capacity; {MAX_REPLAY_BYTES / 1e9:.0f} GB are allowed",
            )

        if self.num_parameters > MAX_PARAMETERS:
            raise ConfigError(
                f"agent {self.name}: networks of {self.num_parameters} parameters",
                f"lower get_hidden_size or the layers; {MAX_PARAMETERS} are allowed",
            )

    @property
    def num_parameters(self) -> int:
        """Weights of actor and critics, about."""
        inputs = 3 * self.state_size + 4 * self.action_size
        layers = self.num_actor_layers + 2 * self.num_critic_layers
        return self.hidden_size * (inputs + self.hidden_size * layers)

    def spec(self) -> PolicySpec:
        """Return what it observes and does."""
        return godot_ai_spec(self.name, self.state_size, self.action_size)

    def config(self) -> SACConfig:
        """Return the settings of SAC; those that a game does not say are godot-ai's."""
        return SACConfig(
            hidden_sizes=(self.hidden_size,) * (self.num_actor_layers + 1),
            critic_hidden_sizes=(self.hidden_size,) * (self.num_critic_layers + 1),
            activation="relu",
            learning_rate=3e-4,
            batch_size=self.batch_size,
            replay_capacity=max(self.replay_capacity, self.batch_size),
            save_replay=False,
            learning_starts=0,
            discount=0.99,
            target_rate=0.005,
            target_entropy=-float(self.action_size),
            normalise_observation=False,
        )


class Agent:
    """Acts and learns.

    Args:
        settings: What the game says of it.
        seed: Of all agents of the server; each draws its own random stream from it.
        device: Where to compute.

    Attributes:
        settings: What the game says of it.
        spec: What it observes and does.
        sac: What learns.
        num_steps: Gradient steps so far.
        num_transitions: Transitions so far.
        num_replays: Those of them that came since the agent was made, so that it has them.
    """

    def __init__(self, settings: AgentSettings, seed: int, device: torch.device) -> None:
        self.settings = settings
        self.spec = settings.spec()
        self.num_steps = 0
        self.num_transitions = 0
        self.num_replays = 0
        own = policy_seed(seed, settings.name)
        with cast(Any, torch).random.fork_rng(devices=[]):
            cast(Any, torch).manual_seed(own)
            policy = Policy(self.spec, settings.config()).to(device)
            self.sac = SAC(policy, settings.config(), LearnerSettings([], own))
        self._generator = torch.Generator(device).manual_seed(own + 2)

    @torch.inference_mode()
    def act(self, states: NDArray[np.float32], *, is_deterministic: bool) -> NDArray[np.float32]:
        """Return ``float32[n, action_size]`` in [-1, 1].

        Args:
            states: ``float32[n, state_size]``.
            is_deterministic: Whether to take the most probable action, or to draw one.
        """
        policy = self.sac.policy
        inputs = policy.encoder({ENTRY: as_tensor(states, policy.device)})
        outputs, _ = policy.act_on(inputs, None)
        noise = None
        if not is_deterministic:
            noise = torch.empty(len(states), policy.head.num_noise, device=policy.device)
            policy.head.fill_noise(noise, self._generator)
        _, continuous = policy.head.sample(outputs, noise)
        return policy.head.to_bounds(continuous).cpu().numpy()

    def take_networks(self, saved: GodotAiCheckpoint, path: Path) -> None:
        """Go on from what godot-ai's own server has trained; optimisers begin anew.

        Raises:
            CheckpointError: It was trained with other sizes than the game says.
        """
        sizes = {
            "state_size": "state_dim",
            "action_size": "action_dim",
            "hidden_size": "hidden_size",
            "num_actor_layers": "num_actor_layers",
            "num_critic_layers": "num_critic_layers",
        }
        for name, theirs in sizes.items():
            was, expected = getattr(saved, name), getattr(self.settings, name)
            if was != expected:
                raise CheckpointError(
                    f"{path} was trained with {theirs} {was}, and the game says {expected}",
                    f"let the game say {was}, or move the file away to start over",
                )
        state = self.sac.state()
        state.tensors.update(saved.tensors)
        self.sac.load_state(state)

    def add(self, transitions: Sample) -> None:
        """Take transitions to learn from."""
        self.sac.add_transitions(transitions)
        self.num_transitions += len(transitions.reward)
        self.num_replays += len(transitions.reward)

    def learn(self, num_steps: int, is_stopping: Callable[[], bool]) -> dict[str, float]:
        """Take gradient steps, fewer once ``is_stopping``; return the mean losses.

        Raises:
            DivergenceError: A loss became NaN or infinite; the networks are useless now.
        """
        sums = dict.fromkeys(LOSS_METRICS, 0.0)
        done = 0
        while done < num_steps and not is_stopping():
            num = min(MAX_STEPS_AT_ONCE, num_steps - done)
            metrics = self.sac.learn(num)
            for name in LOSS_METRICS:
                sums[name] += num * metrics[name]
            done += num
        self.num_steps += done
        return {name: value / done for name, value in sums.items()} if done else {}
