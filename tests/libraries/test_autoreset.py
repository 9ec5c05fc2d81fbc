"""Gymnasium's three autoreset modes: equal to its own vector environment, and exact on Godot."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, cast

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import ludus
from ludus.errors import SequenceError, UsageError

NUM = 5


class Masked(gymnasium.Env[Any, Any]):
    """Ends at chance, and allows other actions in every step."""

    observation_space = gymnasium.spaces.Dict({
        "vector": gymnasium.spaces.Box(0.0, 1.0, (2,)),
        "image": gymnasium.spaces.Box(0, 255, (2, 2, 1), np.uint8),
    })  # fmt: skip
    action_space = gymnasium.spaces.Discrete(3)

    def observe(self) -> tuple[Any, dict[str, Any]]:
        observation = {
            "vector": self.np_random.random(2, np.float32),
            "image": self.np_random.integers(256, size=(2, 2, 1), dtype=np.uint8),
        }
        return observation, {"action_mask": self.np_random.random(3) < 0.5}

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        return self.observe()

    def step(self, action: Any) -> Any:
        observation, info = self.observe()
        return observation, float(action), *(self.np_random.random(2) < 0.2).tolist(), info


@pytest.fixture(scope="module", autouse=True)
def _masked() -> Iterator[None]:
    cast(Any, gymnasium).register("MaskedImage-v0", Masked)
    yield
    del gymnasium.registry["MaskedImage-v0"]


def both(env_id: str, mode: str) -> tuple[Any, Any]:
    make: Callable[[], Any] = partial(gymnasium.make, env_id)
    own = ludus.make_vec(f"gym:{env_id}", num_worlds=NUM, autoreset_mode=mode)
    theirs = SyncVectorEnv([make] * NUM, autoreset_mode=AutoresetMode[mode.upper()])
    assert own.metadata["autoreset_mode"] is theirs.metadata["autoreset_mode"]
    return own, theirs


def assert_equal(own: Any, theirs: Any) -> None:
    """Compare observation, reward, ends and infos; rewards are float32 here, and float64 there."""
    np.testing.assert_equal(own[0], theirs[0])
    if len(own) == 5:
        np.testing.assert_array_equal(own[1], theirs[1].astype(np.float32))
        np.testing.assert_array_equal(own[2], theirs[2])
        np.testing.assert_array_equal(own[3], theirs[3])
    for key in ("final_obs", "_final_obs", "_final_info"):
        assert (key in own[-1]) == (key in theirs[-1])
        np.testing.assert_equal(list(own[-1].get(key, ())), list(theirs[-1].get(key, ())))


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["same_step", "next_step", "disabled"])
@pytest.mark.parametrize("env_id", ["CartPole-v1", "Pendulum-v1", "MaskedImage-v0"])
def test_modes_equal_gymnasiums_own_to_the_bit(env_id: str, mode: str) -> None:
    own, theirs = both(env_id, mode)
    own.action_space.seed(3)
    assert_equal(own.reset(seed=7), theirs.reset(seed=7))
    num_ends, rng = 0, np.random.default_rng(0)
    for step in range(450):
        actions = own.action_space.sample()
        own_answer, their_answer = own.step(actions), theirs.step(actions)
        assert_equal(own_answer, their_answer)
        ended = own_answer[2] | own_answer[3]
        num_ends += ended.sum()
        if mode == "disabled":
            while ended.any():  # some first, then the rest, with and without a seed
                chosen = ended & (rng.random(NUM) < 0.6)
                if chosen.any():
                    given: dict[str, Any] = {"options": {"reset_mask": chosen}}
                    if rng.random() < 0.3:
                        given["seed"] = [step + i for i in range(NUM)]
                    assert_equal(own.reset(**given), theirs.reset(**copy.deepcopy(given)))
                    ended &= ~chosen
        elif rng.random() < 0.004:
            assert_equal(own.reset(), theirs.reset())
    assert num_ends >= NUM
    own.close()
    theirs.close()


@pytest.mark.parametrize("mode", ["same_step", "next_step", "disabled"])
def test_a_reset_of_no_world_returns_what_was_seen_last(mode: str) -> None:
    own, _ = both("CartPole-v1", mode)
    nothing, num_ends = {"reset_mask": np.zeros(NUM, np.bool_)}, 0
    seen, _ = own.reset(seed=7)
    np.testing.assert_array_equal(own.reset(options=nothing)[0], seen)
    own.action_space.seed(3)
    for _ in range(100):
        seen, _, terminated, truncated, _ = own.step(own.action_space.sample())
        np.testing.assert_array_equal(own.reset(options=nothing)[0], seen)
        ended = terminated | truncated
        num_ends += ended.sum()
        if mode == "disabled":  # as the docs have it, whether an episode has ended or not
            begun, _ = own.reset(options={"reset_mask": ended})
            np.testing.assert_array_equal(begun[~ended], seen[~ended])
            assert (begun[ended] != seen[ended]).any(axis=1).all()
    assert num_ends > NUM
    own.close()


@pytest.mark.parametrize("mode", ["next_step", "disabled"])
def test_the_first_reset_cannot_leave_all_worlds_out(mode: str) -> None:
    own, _ = both("CartPole-v1", mode)
    with pytest.raises(SequenceError, match="nothing to observe yet"):
        own.reset(options={"reset_mask": np.zeros(NUM, np.bool_)})
    own.close()


@pytest.mark.engine
def test_a_reset_of_no_world_leaves_worlds_of_godot_alone(oracle: Path) -> None:
    envs = ludus.make_vec(oracle, num_worlds=2, num_engines=2, autoreset_mode="disabled")
    try:
        envs.reset(seed=11, options={"parameters": PARAMETERS})
        for _ in range(8):
            seen, _, terminated, truncated, _ = envs.step(np.zeros(4, np.int64))
            ended = terminated | truncated
            begun, _ = envs.reset(options={"reset_mask": ended})
            np.testing.assert_array_equal(begun[~ended], seen[~ended])
            assert not begun[ended, 1].any()
    finally:
        envs.close()


def test_masks_are_those_of_the_observation() -> None:
    own, theirs = both("MaskedImage-v0", "next_step")
    own.reset(seed=1)
    theirs.reset(seed=1)
    for _ in range(100):
        actions = np.zeros(NUM, np.int64)
        (*_, terminated, truncated, infos), (*_, their_infos) = (
            own.step(actions),
            theirs.step(actions),
        )
        goes_on = ~(terminated | truncated)
        np.testing.assert_array_equal(
            infos["action_mask"][goes_on], their_infos["action_mask"][goes_on]
        )
        np.testing.assert_array_equal(infos["_action_mask"], their_infos["_action_mask"])
    own.close()
    theirs.close()


def test_a_mode_that_does_not_exist_is_refused() -> None:
    with pytest.raises(UsageError, match="autoreset_mode is 'later', expected 'same_step'"):
        ludus.make_vec("gym:CartPole-v1", autoreset_mode="later")


LENGTHS = [2, 3, 5, 0]
PARAMETERS = [{"length": length} for length in LENGTHS]


@pytest.mark.engine
def test_next_step_on_godot_is_exact(oracle: Path) -> None:
    envs = ludus.make_vec(oracle, num_worlds=2, num_engines=2, autoreset_mode="next_step")
    try:
        envs.reset(seed=11, options={"parameters": PARAMETERS})
        steps, has_ended = np.zeros(4, int), np.zeros(4, bool)
        randoms: list[set[Any]] = [set() for _ in LENGTHS]
        for number in range(1, 25):
            observation, reward, terminated, truncated, infos = envs.step(np.full(4, number % 5))
            steps = np.where(has_ended, 0, steps + 1)
            last = np.where(has_ended, -1, number % 5)
            has_ended = ~has_ended & (steps == LENGTHS)
            np.testing.assert_array_equal(terminated, has_ended)
            np.testing.assert_array_equal(observation[:, 1], steps)
            np.testing.assert_array_equal(observation[:, 2], last)
            np.testing.assert_array_equal(observation[:, 4], 2 * steps)  # no tick was lost
            np.testing.assert_allclose(reward, 0.1 * steps, rtol=1e-6)
            assert not truncated.any()
            assert not infos
            for row in range(4):
                randoms[row].add((observation[row, 0], observation[row, 3]))
        assert [len(seen) for seen in randoms] == [9, 7, 5, 1]  # one random number an episode
    finally:
        envs.close()


@pytest.mark.engine
def test_disabled_on_godot_hands_out_what_the_step_has_brought(oracle: Path) -> None:
    envs = ludus.make_vec(oracle, num_worlds=3, autoreset_mode="disabled")
    actions = np.zeros(3, np.int64)
    try:
        envs.reset(seed=1, options={"parameters": [{"length": 1}, {"length": 1}, {"length": 0}]})
        observation, _, terminated, _, infos = envs.step(actions)
        assert terminated.tolist() == [True, True, False]
        assert observation[:, :2].tolist() == [[1, 1], [1, 1], [1, 1]]
        assert not infos
        with pytest.raises(SequenceError, match=r"(?s)world 0 is over.*reset_mask"):
            envs.step(actions)
        observation, _ = envs.reset(options={"reset_mask": np.array([True, False, False])})
        assert observation[:, :2].tolist() == [[2, 0], [1, 1], [1, 1]]
        with pytest.raises(SequenceError, match="world 1 is over"):
            envs.step(actions)
        seeds = [None, 5, None]
        observation, _ = envs.reset(seed=seeds, options={"reset_mask": np.array([0, 1, 0], bool)})
        assert observation[:, :2].tolist() == [[2, 0], [1, 0], [1, 1]]
        assert envs.step(actions)[0][:, :2].tolist() == [[2, 1], [1, 1], [1, 2]]
    finally:
        envs.close()


@pytest.mark.engine
def test_agents_that_end_together_may_stand_still_and_others_may_not(tasks: Path) -> None:
    with pytest.raises(UsageError, match="16 agents end one by one"):
        ludus.make_vec("ball_chase", autoreset_mode="next_step")
    envs = ludus.make_vec(
        tasks / "oracle_world.tscn", policy="runner", num_worlds=2, autoreset_mode="next_step"
    )
    envs.close()


@pytest.mark.engine
def test_an_engine_that_dies_between_episodes_is_started_again(oracle: Path) -> None:
    envs = ludus.make_vec(oracle, num_worlds=2, autoreset_mode="next_step")
    try:
        envs.reset(seed=1, options={"parameters": {"length": 1}})
        assert envs.step(np.zeros(2, np.int64))[2].all()
        session: Any = envs.pool.sessions[0]
        session._supervision._process.terminate()
        observation, reward, terminated, truncated, _ = envs.step(np.zeros(2, np.int64))
        assert observation[:, :2].tolist() == [[1, 0], [1, 0]]
        assert not (reward.any() or terminated.any() or truncated.any())
        assert envs.pool.num_restarts == 1
    finally:
        envs.close()
