from __future__ import annotations

from typing import Any, ClassVar, cast

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec

import ludus
from ludus.errors import ConfigError, SequenceError, TargetError
from ludus.pool import Pool, PoolConfig, open_pool
from ludus.spec.batch import ActionBatch
from tests.training.environments import Constant


def actions(pool: Pool, engine: int | None = None) -> dict[str, ActionBatch]:
    spec = pool.policies["agent"]
    count = pool.num_agents("agent") if engine is None else spec.num_agents
    return {"agent": ActionBatch.zeros(spec, count)}


def test_same_step_autoreset_on_truncation() -> None:
    pool = open_pool("gym:Truncated-v0", PoolConfig(num_worlds=2, num_engines=2))
    assert pool.policies["agent"].max_episode_steps == 5
    batch = pool.reset(0)["agent"]
    assert batch.active.all()
    for step in range(1, 11):
        batch = pool.step(actions(pool))["agent"]
        is_last = step % 5 == 0
        assert batch.truncated.tolist() == [is_last] * 4
        assert not batch.terminated.any()
        assert batch.final_index.tolist() == ([0, 1, 2, 3] if is_last else [])
    pool.close()


def test_final_observation_is_the_old_episodes_and_observation_the_new_ones() -> None:
    pool = open_pool("gym:Terminated-v0", PoolConfig(num_worlds=1))
    pool.reset(0)
    for _ in range(4):
        pool.step(actions(pool))
    batch = pool.step(actions(pool))["agent"]
    assert batch.terminated.tolist() == [True]
    assert batch.final_observation["observation"].tolist() == [[1.0]]
    assert batch.observation["observation"].tolist() == [[0.0]]


def test_send_and_receive_one_engine() -> None:
    pool = open_pool("gym:Identity-discrete-v0", PoolConfig(num_worlds=3, num_engines=2))
    first = pool.reset(5)["agent"].observation["observation"]
    again = open_pool("gym:Identity-discrete-v0", PoolConfig(num_worlds=6)).reset(5)["agent"]
    np.testing.assert_array_equal(first, again.observation["observation"])
    with pytest.raises(SequenceError, match="nothing to receive"):
        pool.receive(1)
    pool.send(1, actions(pool, 1))
    with pytest.raises(SequenceError, match="twice"):
        pool.send(1, actions(pool, 1))
    batch = pool.receive(1)["agent"]
    paid = first[3:, 0] == 1.0
    np.testing.assert_array_equal(batch.reward, paid.astype(np.float32))


def test_refuses_to_step_before_reset() -> None:
    pool = open_pool("gym:Identity-discrete-v0")
    with pytest.raises(SequenceError, match="before the first reset"):
        pool.step(actions(pool))


def test_dictionaries_images_and_shifted_actions() -> None:
    pool = open_pool("gym:Pictures-v0", PoolConfig(num_worlds=2))
    spec = pool.policies["agent"]
    assert [(e.name, e.dtype, e.shape) for e in spec.observation] == [
        ("image", "uint8", (12, 12, 1)),
        ("number", "float32", (1,)),
    ]
    batch = pool.reset(0)["agent"]
    bright = batch.observation["image"][:, 0, 6, 0] > 0
    right = ActionBatch(bright[:, None].astype(np.int64), np.zeros((2, 0), np.float32))
    batch = pool.step({"agent": right})["agent"]
    assert batch.reward.tolist() == [1.0, 1.0]
    assert batch.final_observation["image"].shape == (2, 12, 12, 1)


def test_masks_and_bounds() -> None:
    masked = open_pool("gym:Masked-v0", PoolConfig(num_worlds=2))
    mask = masked.reset(0)["agent"].action_mask
    assert mask is not None
    assert mask.sum(1).tolist() == [2, 2]
    low, high = open_pool("gym:Identity-continuous-v0").policies["agent"].continuous_bounds()
    assert (low.tolist(), high.tolist()) == ([-2.0, -2.0], [6.0, 6.0])


@pytest.mark.parametrize("env_id", ["Nowhere-v0", "no_such_module:Nowhere-v0"])
def test_unknown_environment(env_id: str) -> None:
    with pytest.raises(TargetError, match="cannot make"):
        open_pool(f"gym:{env_id}")


class Frail(Constant):
    """Environment ``broken`` cannot be made, ``stubborn`` cannot be closed; counted from 0."""

    broken = stubborn = -1
    made: ClassVar[list[int]] = []
    closed: ClassVar[list[int]] = []

    def __init__(self) -> None:
        super().__init__()
        if len(self.made) == self.broken:
            raise RuntimeError("it cannot be made")
        self.number = len(self.made)
        self.made.append(self.number)

    def close(self) -> None:
        if self.number == self.stubborn:
            raise RuntimeError("it cannot be closed")
        self.closed.append(self.number)


@pytest.fixture
def frail(monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.setattr(Frail, "made", [])
    monkeypatch.setattr(Frail, "closed", [])
    spec = EnvSpec("Frail-v0", cast(Any, Frail))
    monkeypatch.setitem(cast(Any, gymnasium).registry, "Frail-v0", spec)
    return "gym:Frail-v0"


@pytest.mark.parametrize("number", range(4))
def test_an_environment_that_cannot_be_closed_leaves_none_of_the_others(
    frail: str, number: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Frail, "stubborn", number)
    pool = open_pool(frail, PoolConfig(num_worlds=2, num_engines=2))
    with pytest.raises(RuntimeError, match="it cannot be closed"):
        pool.close()
    assert set(Frail.closed) == {0, 1, 2, 3} - {number}


@pytest.mark.parametrize("number", [1, 2, 3])
def test_an_environment_that_cannot_be_made_leaves_none_of_the_others(
    frail: str, number: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Frail, "broken", number)
    with pytest.raises(RuntimeError, match="it cannot be made"):
        open_pool(frail, PoolConfig(num_worlds=2, num_engines=2))
    assert sorted(Frail.closed) == list(range(number))


def test_settings_of_engines_are_refused() -> None:
    with pytest.raises(ConfigError, match="gym:Truncated-v0 has no engine: layout, ticks_per_step"):
        open_pool("gym:Truncated-v0", PoolConfig(layout="grid", ticks_per_step=4))
    open_pool("gym:Truncated-v0", PoolConfig(layout="isolated")).close()


def test_is_a_target_of_make_too() -> None:
    env = ludus.make("gym:Truncated-v0")
    env.reset(seed=1)
    assert [env.step(env.action_space.sample())[3] for _ in range(5)] == [False] * 4 + [True]
    env.close()
    envs = ludus.make_vec("gym:Truncated-v0", num_worlds=2, num_engines=2)
    assert envs.num_envs == 4
    envs.close()


def test_unsupported_space() -> None:
    with pytest.raises(TargetError, match="cannot train with the observation"):
        open_pool("gym:FrozenLake-v1")
