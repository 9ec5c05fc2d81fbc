"""Check that our PPO is that of Stable-Baselines3: one update from equal beginnings, on Hopper-v5.

Theirs collects rollouts. Before each update ours gets their weights, their rollout and their order
of minibatches; afterwards the weights of both are compared. Then ours collects rollouts, and its
advantages are computed once more by the recursion of the paper, episode by episode. What is left
between two learning curves after that is chance.

    PYTHONPATH=/tmp/sb3 python benchmarks/same_update.py

``algorithms.py`` says how to get Stable-Baselines3.
"""

from __future__ import annotations

import itertools
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from typing import Any, cast

import numpy as np
import torch
import tyro
from algorithms_tasks import PPO_DEFAULTS, TASKS, their_model
from torch import Tensor, nn

from ludus.algorithms.learner import LearnerSettings
from ludus.algorithms.ppo import PPO
from ludus.algorithms.transitions import Transitions
from ludus.networks.networks import Inputs
from ludus.networks.policy import Policy
from ludus.pool import PoolConfig, open_pool

TASK = TASKS["hopper-ppo"]
STEPS = PPO_DEFAULTS.rollout_steps


def linears(*modules: nn.Module) -> list[nn.Linear]:
    """Return the linear layers of some modules, in order."""
    every = itertools.chain.from_iterable(module.modules() for module in modules)
    return [module for module in every if isinstance(module, nn.Linear)]


class Pair:
    """Their model, and our learner with the same networks."""

    def __init__(self, seed: int) -> None:
        torch.set_num_threads(1)
        self.theirs: Any = their_model(TASK, seed)
        self.pool = open_pool(f"gym:{TASK.env_id}")
        self.policy = Policy(self.pool.policies["agent"], PPO_DEFAULTS)
        self.ours = PPO(self.policy, PPO_DEFAULTS, LearnerSettings([slice(0, 1)], seed))

    def layers(self) -> Iterator[tuple[nn.Linear, nn.Linear]]:
        """Yield each of our layers with theirs."""
        theirs = self.theirs.policy
        critic = cast(nn.Module, cast(Any, self.ours)._critic)
        ours = linears(self.policy.actor, critic)
        actor, value = theirs.mlp_extractor.policy_net, theirs.mlp_extractor.value_net
        parts = linears(actor, theirs.action_net, value, theirs.value_net)
        return zip(ours, parts, strict=True)

    @torch.no_grad()
    def equalise(self) -> None:
        """Give ours their weights; the optimisers keep their moments."""
        for ours, theirs in self.layers():
            ours.weight.copy_(theirs.weight)
            ours.bias.copy_(theirs.bias)
        assert self.policy.head.log_std is not None
        self.policy.head.log_std.copy_(self.theirs.policy.log_std)

    @torch.no_grad()
    def weights(self) -> tuple[Tensor, Tensor]:
        """Return all weights of ours, and theirs, as vectors."""
        pairs = [(ours.weight.flatten(), theirs.weight.flatten()) for ours, theirs in self.layers()]
        return torch.cat([pair[0] for pair in pairs]), torch.cat([pair[1] for pair in pairs])

    def their_rollout(self) -> Transitions:
        """Return what theirs is about to learn from."""
        buffer = self.theirs.rollout_buffer

        def tensor(values: Any) -> Tensor:
            array = np.asarray(values, np.float32)
            return torch.as_tensor(array.reshape(STEPS, *array.shape[2:]).copy())

        return Transitions(
            Inputs(tensor(buffer.observations)), torch.zeros(STEPS, 0, dtype=torch.int64),
            tensor(buffer.actions), None, tensor(buffer.log_probs), tensor(buffer.values),
            tensor(buffer.advantages), tensor(buffer.returns),
        )  # fmt: skip


@contextmanager
def recorded(orders: list[Tensor]) -> Generator[None]:
    """Note the permutations that theirs draws."""
    permutation = np.random.permutation

    def draw(length: int) -> Any:
        order = permutation(length)
        orders.append(torch.as_tensor(order.copy()))
        return order

    np.random.permutation = draw  # type: ignore[assignment]
    try:
        yield
    finally:
        np.random.permutation = permutation


@contextmanager
def replayed(orders: list[Tensor]) -> Generator[None]:
    """Let ours draw the same."""
    permutation, left = torch.randperm, iter(orders)

    def draw(*_: Any, **__: Any) -> Tensor:
        return next(left)

    torch.randperm = draw
    try:
        yield
    finally:
        torch.randperm = permutation


def compare_updates(pair: Pair, num_updates: int) -> None:
    """Let theirs learn, ours beside it, and print how far they are apart after each update."""
    learn = pair.theirs.train

    def both() -> None:
        pair.equalise()
        before = pair.weights()[1].clone()
        rollout, orders = pair.their_rollout(), cast(list[Tensor], [])
        with recorded(orders):
            learn()
        learner = cast(Any, pair.ours)
        with replayed(orders):
            for _ in learner._optimise(rollout):
                pass
        ours, theirs = pair.weights()
        moved = float(torch.dist(theirs, before))
        apart = float(torch.dist(theirs, ours))
        print(f"moved by {moved:.4f}, apart by {apart:.6f} ({apart / moved:.2%})", flush=True)

    pair.theirs.train = both
    pair.theirs.learn(STEPS * num_updates)


def compare_advantages(pair: Pair, num_rollouts: int) -> None:
    """Let ours collect, and print how far its advantages are from those of a plain loop."""
    learner = cast(Any, pair.ours)
    batches = pair.pool.reset(seed=0)
    learner.begin(0, batches["agent"])
    for _ in range(num_rollouts):
        nexts: list[tuple[Tensor, float, bool, bool]] = []
        for _ in range(STEPS):
            pair.pool.send(0, {"agent": learner.act(0)})
            batch = pair.pool.receive(0)["agent"]
            ended = len(batch.final_index) > 0
            seen = batch.final_observation if ended else batch.observation
            state = torch.as_tensor(seen["observation"][0].copy())
            outcome = (float(batch.reward[0]), bool(batch.terminated[0]), bool(batch.truncated[0]))
            nexts.append((state, *outcome))
            learner.record(0, batch)
        ours = learner._transitions()
        plain = plain_advantages(pair.ours, ours.value, nexts)
        num_cut = sum(truncated for *_, truncated in nexts)
        apart = float((plain - ours.advantage).abs().max())
        print(f"advantages up to {float(plain.abs().max()):.2f}, apart by at most {apart:.6f}; "
              f"{num_cut} episodes cut off", flush=True)  # fmt: skip
        learner._restart()


@torch.no_grad()
def plain_advantages(
    learner: PPO, value: Tensor, nexts: list[tuple[Tensor, float, bool, bool]]
) -> Tensor:
    """Return the advantages of one environment, equations 11 to 16 of arXiv:1506.02438."""
    discount, decay = learner.config.discount, learner.config.discount * learner.config.gae_lambda
    advantages, following = torch.zeros(len(nexts)), 0.0
    for step in reversed(range(len(nexts))):
        state, reward, terminated, truncated = nexts[step]
        next_value = 0.0 if terminated else float(learner.value(state.unsqueeze(0)))
        delta = reward + discount * next_value - float(value[step])
        following = delta + decay * following * (not (terminated or truncated))
        advantages[step] = following
    return advantages


def main(seed: int = 0, num_updates: int = 5, num_rollouts: int = 3) -> None:
    """Compare.

    Args:
        seed: Seed of both.
        num_updates: Updates of theirs.
        num_rollouts: Rollouts of ours.
    """
    pair = Pair(seed)
    compare_updates(pair, num_updates)
    compare_advantages(pair, num_rollouts)
    pair.pool = open_pool(f"gym:{TASK.env_id}", PoolConfig(max_episode_steps=37))
    compare_advantages(pair, num_rollouts)


if __name__ == "__main__":
    tyro.cli(main)
