"""Gymnasium's wrappers around our environments; `make test-libraries` tries three versions."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers import (
    FrameStackObservation,
    NormalizeObservation,
    NormalizeReward,
    RecordEpisodeStatistics,
    RecordVideo,
)
from gymnasium.wrappers import vector as vector_wrappers

import ludus
from ludus.check import CheckConfig, run_checks
from ludus.errors import UsageError
from ludus.wrappers import RecordEpisodeStatistics as OurStatistics

VERSION = tuple(int(part) for part in gymnasium.__version__.split(".")[:2])
LENGTHS = [2, 3, 5]
NUM = len(LENGTHS)


@pytest.fixture
def cartpole() -> Iterator[Any]:
    env = gymnasium.make("ludus/CartPole-v0")
    yield env
    env.close()


def play(envs: Any, num_steps: int) -> list[list[tuple[int, float]]]:
    """Step the oracle's worlds of ``LENGTHS``; return lengths and returns that infos told."""
    is_asked = envs.metadata["autoreset_mode"] is AutoresetMode.DISABLED
    parameters = [{"length": length} for length in LENGTHS]
    envs.reset(seed=1, options={"parameters": parameters})
    told: list[list[tuple[int, float]]] = [[] for _ in LENGTHS]
    for _ in range(num_steps):
        *_, terminated, truncated, infos = envs.step(np.zeros(NUM, np.int64))
        ended = terminated | truncated
        assert ("episode" in infos) == ended.any()
        for row in np.flatnonzero(ended):
            assert infos["_episode"][row]
            told[row].append((int(infos["episode"]["l"][row]), float(infos["episode"]["r"][row])))
        if is_asked and ended.any():
            envs.reset(options={"reset_mask": ended})
    return told


def expected(num_steps: int, pause: int) -> list[Any]:
    """Rewards of the oracle are 0.1, 0.2, …; next-step autoreset pauses for a step."""
    return [
        [pytest.approx((length, 0.05 * length * (length + 1)))]
        * ((num_steps + pause) // (length + pause))
        for length in LENGTHS
    ]


@pytest.mark.engine
@pytest.mark.parametrize("mode", ["same_step", "next_step", "disabled"])
def test_our_statistics_are_right_in_every_mode(mode: str, oracle: Path) -> None:
    envs = OurStatistics(ludus.make_vec(oracle, num_worlds=NUM, autoreset_mode=mode))
    try:
        told = play(envs, 24)
        assert told == expected(24, pause=int(mode == "next_step"))
        assert envs.episode_count == sum(map(len, told))
        assert len(envs.return_queue) == len(envs.time_queue) == envs.episode_count
        assert sorted(set(envs.length_queue)) == LENGTHS
    finally:
        envs.close()


@pytest.mark.engine
@pytest.mark.parametrize("mode", ["same_step", "next_step"])
def test_gymnasiums_statistics_are_right_but_for_same_step_up_to_1_3(
    mode: str, oracle: Path
) -> None:
    own = ludus.make_vec(oracle, num_worlds=NUM, autoreset_mode=mode)
    envs = vector_wrappers.RecordEpisodeStatistics(own)
    try:
        is_right = play(envs, 24) == expected(24, pause=int(mode == "next_step"))
        assert is_right == (mode == "next_step" or VERSION >= (1, 4))
    finally:
        envs.close()


EARLY, LATE = pytest.approx((2, 0.3)), pytest.approx((5, 1.5))


@pytest.mark.engine
@pytest.mark.parametrize("mode", ["same_step", "next_step", "disabled"])
def test_our_statistics_leave_out_steps_in_which_an_agent_waits(mode: str, tasks: Path) -> None:
    envs: Any = ludus.make_vec(
        tasks / "oracle_world.tscn", policy="runner", num_worlds=2, autoreset_mode=mode
    )
    envs = OurStatistics(envs)
    try:
        envs.reset(seed=1)
        told: list[list[tuple[int, float]]] = [[] for _ in range(envs.num_envs)]
        for _ in range(16):
            *_, terminated, truncated, infos = envs.step(np.zeros(envs.num_envs, np.int64))
            episode = infos.get("episode", {})
            for row in np.flatnonzero(terminated | truncated):
                told[row].append((int(episode["l"][row]), float(episode["r"][row])))
            if mode == "disabled" and terminated[1]:
                envs.reset(options={"reset_mask": terminated})
        num_late = 2 if mode == "next_step" else 3
        assert told == [[EARLY] * 3, [LATE] * num_late, []] * 2  # the third slot is free
    finally:
        envs.close()


@pytest.mark.engine
def test_our_statistics_begin_anew_with_all_agents_of_a_world(tasks: Path) -> None:
    envs: Any = OurStatistics(
        ludus.make_vec(tasks / "oracle_world.tscn", policy="runner", num_worlds=2)
    )
    actions = np.zeros(envs.num_envs, np.int64)
    try:
        envs.reset(seed=1)
        envs.step(actions)
        envs.reset(options={"reset_mask": np.arange(envs.num_envs) == 1})
        assert envs.step(actions)[-1]["_episode"].tolist() == [False] * 3 + [True] + [False] * 2
        infos = envs.step(actions)[-1]
        assert infos["_episode"][0]
        assert (infos["episode"]["l"][0], infos["episode"]["r"][0]) == EARLY
    finally:
        envs.close()


def test_statistics_need_an_autoreset_mode() -> None:
    envs: Any = SyncVectorEnv([partial(gymnasium.make, "CartPole-v1")])
    envs.metadata = {}
    with pytest.raises(UsageError, match=r"metadata\['autoreset_mode'\] is None"):
        OurStatistics(envs)
    envs.close()


WRAPPERS: list[Callable[[Any], Any]] = [
    vector_wrappers.NormalizeObservation,
    vector_wrappers.NormalizeReward,
    vector_wrappers.RecordEpisodeStatistics,
]


@pytest.mark.parametrize("wrap", WRAPPERS)
def test_vector_wrappers_give_what_they_give_around_sync_vector_env(
    wrap: Callable[[Any], Any],
) -> None:
    own = wrap(ludus.make_vec("gym:CartPole-v1", num_worlds=NUM, autoreset_mode="next_step"))
    theirs = wrap(SyncVectorEnv([partial(gymnasium.make, "CartPole-v1")] * NUM))
    np.testing.assert_array_equal(own.reset(seed=2)[0], theirs.reset(seed=2)[0])
    num_ends = 0
    for _ in range(120):
        actions = np.ones(NUM, np.int64)
        mine, other = own.step(actions), theirs.step(actions)
        np.testing.assert_array_equal(mine[0], other[0])
        np.testing.assert_allclose(mine[1], other[1], rtol=1e-6)
        num_ends += int(mine[2].sum())
        if "episode" in other[4]:
            for key in "rl":
                np.testing.assert_array_equal(mine[4]["episode"][key], other[4]["episode"][key])
    assert num_ends > NUM
    own.close()
    theirs.close()


def test_observation_wrappers_of_gymnasium_refuse_same_step() -> None:
    envs = ludus.make_vec("gym:CartPole-v1", num_worlds=NUM)
    with pytest.raises((ValueError, AssertionError)):
        vector_wrappers.NormalizeObservation(envs)
    envs.close()


@pytest.mark.engine
def test_single_wrappers_wrap_a_game(cartpole: Any) -> None:
    env: Any = RecordEpisodeStatistics(NormalizeReward(NormalizeObservation(cartpole)))
    env = FrameStackObservation(env, 3)
    observation, _ = env.reset(seed=1)
    size = cartpole.observation_space.shape[0]
    assert observation.shape == (3, size)
    lengths: list[int] = []
    for episode in range(3):
        length, info, has_ended = 0, dict[str, Any](), False
        while not has_ended:
            previous = observation
            observation, _, terminated, truncated, info = env.step(0)
            np.testing.assert_array_equal(observation[:2], previous[1:])
            assert np.isfinite(observation).all()
            length, has_ended = length + 1, terminated or truncated
        assert info["episode"]["l"] == length
        lengths.append(length)
        observation, _ = env.reset()
        assert len(env.get_wrapper_attr("length_queue")) == episode + 1
    assert list(env.get_wrapper_attr("length_queue")) == lengths


@pytest.mark.engine
@pytest.mark.libraries  # tests of the checks run with one version of Gymnasium only
def test_a_game_passes_ludus_check() -> None:
    report = run_checks(
        CheckConfig(target="cartpole", num_steps=60, num_layout_worlds=8, timing_s=0.05)
    )
    assert report.is_ok, report.findings


@pytest.mark.libraries  # moviepy writes the film
@pytest.mark.screen
@pytest.mark.filterwarnings("ignore")  # of moviepy, which forgets to close
@pytest.mark.parametrize("is_vector", [False, True])
def test_record_video_films_a_game(is_vector: bool, tmp_path: Path) -> None:
    if is_vector and VERSION < (1, 2):
        assert not hasattr(vector_wrappers, "RecordVideo")
        return
    env: Any
    if is_vector:
        env = ludus.make_vec("cartpole", num_worlds=2, render_mode="rgb_array")
        env = vector_wrappers.RecordVideo(env, str(tmp_path), video_length=5)  # type: ignore[attr-defined]
    else:
        env = gymnasium.make("ludus/CartPole-v0", render_mode="rgb_array")
        env = RecordVideo(env, str(tmp_path), video_length=5)
    try:
        env.reset(seed=1)
        for _ in range(8):
            env.step(env.action_space.sample())
    finally:
        env.close()
    (film,) = tmp_path.glob("*.mp4")
    assert film.stat().st_size > 1000
