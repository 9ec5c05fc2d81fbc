"""TorchRL's own wrappers do all of it: no module of ours is needed."""

# TorchRL's types are incomplete.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownParameterType=false

from __future__ import annotations

from typing import Any, cast

import pytest

pytest.importorskip("torchrl")

from torchrl.envs import check_env_specs
from torchrl.envs.libs.gym import GymEnv, GymWrapper
from torchrl.envs.libs.pettingzoo import PettingZooWrapper

import ludus
from ludus.pettingzoo import parallel_env

pytestmark = [
    pytest.mark.libraries,
    pytest.mark.engine,
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
