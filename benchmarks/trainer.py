"""Our trainer beside a loop in CleanRL's manner, in turns: trained steps a second.

    python benchmarks/trainer.py
    python benchmarks/trainer.py --target ball_chase --num-worlds 2 --num-engines 1

The loop is what people write who follow CleanRL's ``ppo.py``: one file, autograd, ``torch.optim``,
Gymnasium's vector interface over the same engines, and the settings of `ludus train`. Each turn
trains both for some steps; starting the engines does not count.
"""

# The types of PyTorch's distributions are incomplete.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false
from __future__ import annotations

import statistics
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
import tyro
from torch import Tensor, nn
from torch.distributions import Categorical, Independent, Normal

import ludus
from ludus.settings.policy_config import PPOConfig
from ludus.training.hooks import Training

PPO = PPOConfig()


@dataclass(frozen=True)
class Options:
    """What to train.

    Attributes:
        target: A game with one policy and one kind of action.
        num_worlds: Worlds in each engine.
        num_engines: Engines.
        steps: Agent steps of a turn.
        turns: Turns of each; the medians count.
    """

    target: str = "cartpole"
    num_worlds: int = 64
    num_engines: int = 1
    steps: int = 300_000
    turns: int = 5


def layer(inputs: int, outputs: int, gain: float = 2**0.5) -> nn.Linear:
    """Return a layer as CleanRL initialises it."""
    made = nn.Linear(inputs, outputs)
    nn.init.orthogonal_(made.weight, gain)
    nn.init.zeros_(made.bias)
    return made


def perceptron(inputs: int, outputs: int, gain: float) -> nn.Sequential:
    """Return two hidden layers of 64."""
    last = layer(64, outputs, gain)
    return nn.Sequential(layer(inputs, 64), nn.Tanh(), layer(64, 64), nn.Tanh(), last)


class Agent(nn.Module):
    """Actor and critic."""

    def __init__(self, env: ludus.LudusVectorEnv) -> None:
        super().__init__()
        space: Any = env.single_action_space
        self.is_discrete = hasattr(space, "n")
        inputs = int(np.prod(env.single_observation_space.shape or ()))
        outputs = int(space.n) if self.is_discrete else int(np.prod(space.shape))
        self.actor, self.critic = perceptron(inputs, outputs, 0.01), perceptron(inputs, 1, 1.0)
        self.log_std = nn.Parameter(torch.zeros(outputs))

    def distribution(self, observation: Tensor) -> Any:
        """Return that of the actions."""
        outputs = self.actor(observation)
        if self.is_discrete:
            return Categorical(logits=outputs)
        return Independent(Normal(outputs, self.log_std.exp()), 1)


def train_plainly(options: Options) -> float:
    """Train by the loop; return steps a second."""
    env = ludus.make_vec(
        options.target, num_worlds=options.num_worlds, num_engines=options.num_engines
    )
    agent = Agent(env)
    optimiser: Any = cast(Any, torch.optim).Adam(agent.parameters(), lr=PPO.learning_rate, eps=1e-5)
    steps, slots = PPO.rollout_steps, env.num_envs
    observed, _ = env.reset(seed=0)
    observation, began, done = torch.as_tensor(observed).float(), 0.0, torch.zeros(slots)
    num_rollouts = -(-options.steps // (steps * slots))
    for rollout in range(-1, num_rollouts):
        if rollout == 0:  # the first one warms up
            began = time.perf_counter()
        seen: list[Tensor] = []
        taken: list[Tensor] = []
        probable: list[Tensor] = []
        values: list[Tensor] = []
        rewards: list[Tensor] = []
        dones: list[Tensor] = []
        for _ in range(steps):
            with torch.no_grad():
                distribution = agent.distribution(observation)
                action = distribution.sample()
                probable.append(distribution.log_prob(action))
                values.append(agent.critic(observation).squeeze(1))
            seen.append(observation)
            taken.append(action)
            dones.append(done)
            observed, reward, terminated, truncated, _ = env.step(action.numpy())
            observation, done = (
                torch.as_tensor(observed).float(),
                torch.as_tensor(np.logical_or(terminated, truncated)).float(),
            )
            rewards.append(torch.as_tensor(reward).float())
        with torch.no_grad():
            next_value, next_done, last = agent.critic(observation).squeeze(1), done, 0.0
        advantages = [torch.zeros(slots)] * steps
        for step in reversed(range(steps)):
            delta = rewards[step] + PPO.discount * next_value * (1 - next_done) - values[step]
            last = delta + PPO.discount * PPO.gae_lambda * (1 - next_done) * last
            advantages[step], next_value, next_done = last, values[step], dones[step]
        flat = [torch.cat(parts) for parts in (seen, taken, probable, values, advantages)]
        update(agent, optimiser, flat)
    rate = num_rollouts * steps * slots / (time.perf_counter() - began)
    env.close()
    return rate


def update(agent: Agent, optimiser: Any, flat: list[Tensor]) -> None:
    """Take the gradient steps on one rollout."""
    count = len(flat[0])
    for _ in range(PPO.epochs):
        order = torch.randperm(count)
        for rows in order.split(PPO.minibatch_size):
            seen, taken, probable, value, advantage = (part[rows] for part in flat)
            target = advantage + value
            advantage = (advantage - advantage.mean()) / (advantage.std() + 1e-8)
            distribution = agent.distribution(seen)
            ratio = (distribution.log_prob(taken) - probable).exp()
            clipped = ratio.clamp(1 - PPO.clip_range, 1 + PPO.clip_range)
            policy_loss = -torch.min(ratio * advantage, clipped * advantage).mean()
            value_loss = 0.5 * (agent.critic(seen).squeeze(1) - target).square().mean()
            entropy = distribution.entropy().mean()
            loss = (
                policy_loss + PPO.value_coefficient * value_loss
                - PPO.entropy_coefficient * entropy
            )  # fmt: skip
            optimiser.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(agent.parameters(), PPO.max_grad_norm)
            optimiser.step()


def train_ours(options: Options) -> float:
    """Train by ``ludus.train``; return steps a second after the first update."""
    times: list[tuple[float, int]] = []

    def note(training: Training) -> None:
        if training.progress is not None:
            times.append((time.perf_counter(), training.progress.agent_steps))

    with tempfile.TemporaryDirectory() as runs:
        ludus.train(
            options.target, num_worlds=options.num_worlds, num_engines=options.num_engines,
            total_steps=options.steps, evaluation_episodes=0, runs=Path(runs), on_update=note,
            progress=False,
        )  # fmt: skip
    (began, first), (ended, last) = times[0], times[-1]
    return (last - first) / (ended - began)


def main(options: Options) -> None:
    """Print the rates of each turn, and the median of their ratios."""
    ratios: list[float] = []
    for turn in range(options.turns):
        ours, plain = train_ours(options), train_plainly(options)
        ratios.append(ours / plain)
        print(f"turn {turn + 1}: ours {ours:,.0f}, the loop {plain:,.0f} steps/s", flush=True)
    print(f"{options.target}: {statistics.median(ratios):.2f} times as fast")


if __name__ == "__main__":
    sys.exit(main(tyro.cli(Options, description=__doc__)))
