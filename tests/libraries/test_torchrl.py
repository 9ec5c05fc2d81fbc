"""TorchRL's own wrappers do all of it: no module of ours is needed."""

# TorchRL's types are incomplete.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownParameterType=false

from __future__ import annotations

from typing import Any, cast

import pytest

pytest.importorskip("torchrl")

import torch
from tensordict.nn import TensorDictModule
from torch import nn
from torch.distributions import Categorical
from torchrl.envs import check_env_specs
from torchrl.envs.libs.gym import GymEnv, GymWrapper
from torchrl.envs.libs.pettingzoo import PettingZooWrapper
from torchrl.modules import ProbabilisticActor, ValueOperator
from torchrl.objectives import ClipPPOLoss
from torchrl.objectives.value import GAE

import ludus
from ludus.pettingzoo import parallel_env

pytestmark = [
    pytest.mark.libraries,
    pytest.mark.engine,
    pytest.mark.timeout(400, func_only=True),
    pytest.mark.filterwarnings("ignore"),
]


def test_an_environment_by_its_id() -> None:
    env = GymEnv("ludus/CartPole-v0")
    try:
        check_env_specs(env)
        assert env.rollout(10)["next", "reward"].shape[-1] == 1
    finally:
        env.close()


def test_many_worlds_reset_within_a_rollout() -> None:
    env = GymWrapper(ludus.make_vec("cartpole", num_worlds=4))
    try:
        check_env_specs(env)
        rollout = env.rollout(60, break_when_any_done=False)
        assert rollout.batch_size == (4, 60)
        done = rollout["next", "done"]
        assert done.any()
        # Where an episode ends, "next" holds its last observation, not the first of the next one.
        rows, steps, _ = done[:, :-1].nonzero(as_tuple=True)
        last, first = rollout["next", "observation"][rows, steps], rollout["observation"]
        assert (last != first[rows, steps + 1]).any(-1).all()
    finally:
        env.close()


def test_several_policies_are_groups() -> None:
    env = PettingZooWrapper(parallel_env("tag"), use_mask=True)
    try:
        assert set(cast(Any, env.group_map)) == {"chaser", "runner"}
        rollout = env.rollout(10)
        assert rollout["chaser", "action"].shape[0] == 10
    finally:
        env.close()


def test_ppo_as_in_torchrls_tutorial_learns_cartpole() -> None:
    """Collector, GAE and ClipPPOLoss, as https://pytorch.org/rl/stable/tutorials/coding_ppo.html."""
    from torchrl.collectors import Collector  # which warns of itself

    envs = ludus.make_vec("cartpole", num_worlds=16)
    env = GymWrapper(envs, categorical_action_encoding=True)
    actor = ProbabilisticActor(
        TensorDictModule(network(outputs=2), in_keys=["observation"], out_keys=["logits"]),
        in_keys=["logits"],
        distribution_class=Categorical,
        return_log_prob=True,
    )
    critic = ValueOperator(network(outputs=1), in_keys=["observation"])
    advantage = GAE(gamma=0.99, lmbda=0.95, value_network=critic, average_gae=True)
    loss = ClipPPOLoss(actor, critic, entropy_coeff=0.01)
    optimiser = torch.optim.Adam(loss.parameters(), 1e-3)
    collector = Collector(env, actor, frames_per_batch=2048, total_frames=9 * 2048)
    lengths: list[float] = []
    try:
        for batch in collector:
            lengths.append(2048 / max(1, int(batch["next", "done"].sum())))
            for _ in range(8):
                with torch.no_grad():
                    advantage(batch)
                learn_once(loss, optimiser, batch.reshape(-1))
    finally:
        collector.shutdown()
    assert max(lengths) > 4 * lengths[0], lengths


def network(outputs: int) -> nn.Module:
    hidden = [nn.Linear(4, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh()]
    return nn.Sequential(*hidden, nn.Linear(64, outputs))


def learn_once(loss: Any, optimiser: torch.optim.Optimizer, rows: Any) -> None:
    for index in torch.randperm(len(rows)).split(256):
        parts = loss(rows[index])
        optimiser.zero_grad()
        (parts["loss_objective"] + parts["loss_critic"] + parts["loss_entropy"]).backward()
        nn.utils.clip_grad_norm_(loss.parameters(), 1.0)
        optimiser.step()
