"""The example "tag" as a trainer sees it: two policies, one game, rewards that cancel out."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import pytest
from numpy.typing import NDArray

from ludus.pool import EnginePool, PoolConfig, open_pool
from ludus.spec import ContinuousAction, DiscreteAction
from ludus.spec.batch import ActionBatch, Batches

pytestmark = pytest.mark.engine

NUM_WORLDS = 16
ROUND_STEPS = 200
"""10 s, 60 ticks a second, 3 ticks a step."""
SIDE = 640.0
CATCH_GAP = 34.0
PLACE, VELOCITY, TO_OTHER, OTHER_VELOCITY = (slice(i, i + 2) for i in (0, 2, 4, 6))
GAP, TIME_LEFT, PILLARS = 8, 9, slice(10, 25)
STAND = 0


@dataclass
class Rounds:
    """What many steps brought.

    Attributes:
        returns: Per finished round: the chaser's return.
        lengths: Its steps.
        last: Its final observation, as the chaser has it.
    """

    returns: list[float] = field(default_factory=list[float])
    lengths: list[int] = field(default_factory=list[int])
    last: list[NDArray[np.float32]] = field(default_factory=list[NDArray[np.float32]])


@pytest.fixture(scope="module")
def pool() -> Iterator[EnginePool]:
    with open_pool("tag", PoolConfig(num_worlds=NUM_WORLDS)) as pool:
        yield pool


def seen(batches: Batches, policy: str) -> NDArray[np.float32]:
    return batches[policy].observation["observation"]


def act(push: NDArray[np.int64], run: NDArray[np.float32]) -> dict[str, ActionBatch]:
    nothing = len(push), 0
    return {
        "chaser": ActionBatch(push[:, None], np.zeros(nothing, np.float32)),
        "runner": ActionBatch(np.zeros(nothing, np.int64), run),
    }


def push_towards(way: NDArray[np.float32]) -> NDArray[np.int64]:
    """Choose the direction nearest to a way, ``float32[n, 2]``."""
    turns = np.arctan2(way[:, 1], way[:, 0]) / (2 * np.pi)
    return 1 + np.round(8 * turns).astype(np.int64) % 8


def play(pool: EnginePool, num_steps: int, *, is_hunted: bool) -> Rounds:
    """Play with a runner that stands while it is hunted straight on, or both at random."""
    rounds, random = Rounds(), np.random.default_rng(3)
    batches = pool.reset(11)
    returns, lengths = np.zeros(NUM_WORLDS), np.zeros(NUM_WORLDS, int)
    for _ in range(num_steps):
        push = random.integers(0, 9, NUM_WORLDS)
        run = random.uniform(-1, 1, (NUM_WORLDS, 2)).astype(np.float32)
        if is_hunted:
            push, run = push_towards(seen(batches, "chaser")[:, TO_OTHER]), np.zeros_like(run)
        batches = pool.step(act(push, run))
        chaser, runner = batches["chaser"], batches["runner"]
        np.testing.assert_array_equal(chaser.reward, -runner.reward)
        np.testing.assert_array_equal(chaser.terminated, runner.terminated)
        assert not chaser.truncated.any() and not runner.truncated.any()
        returns += chaser.reward
        lengths += 1
        for slot, last in zip(
            chaser.final_index, chaser.final_observation["observation"], strict=True
        ):
            rounds.returns.append(float(returns[slot]))
            rounds.lengths.append(int(lengths[slot]))
            rounds.last.append(last)
            returns[slot], lengths[slot] = 0, 0
    return rounds


def test_one_chooses_and_the_other_steers(pool: EnginePool) -> None:
    chaser, runner = pool.policies["chaser"], pool.policies["runner"]
    assert chaser.action == (DiscreteAction("push", 9),)
    assert [type(part) for part in runner.action] == [ContinuousAction]
    assert runner.continuous_size == 2
    assert chaser.agents_per_world == runner.agents_per_world == 1


def test_both_see_the_same_game_from_two_sides(pool: EnginePool) -> None:
    batches, random = pool.reset(4), np.random.default_rng(4)
    for _ in range(40):
        chaser, runner = seen(batches, "chaser"), seen(batches, "runner")
        np.testing.assert_array_equal(chaser[:, TO_OTHER], -runner[:, TO_OTHER])
        np.testing.assert_array_equal(chaser[:, VELOCITY], runner[:, OTHER_VELOCITY])
        np.testing.assert_array_equal(runner[:, VELOCITY], chaser[:, OTHER_VELOCITY])
        np.testing.assert_array_equal(chaser[:, [GAP, TIME_LEFT]], runner[:, [GAP, TIME_LEFT]])
        way = (runner[:, PLACE] - chaser[:, PLACE]) / 2
        np.testing.assert_allclose(chaser[:, TO_OTHER], way, atol=1e-6)
        pillars = np.stack(
            [
                o[:, PILLARS].reshape(-1, 5, 3)[..., :2] + o[:, None, PLACE] / 2
                for o in (chaser, runner)
            ]
        )
        np.testing.assert_allclose(pillars[0], pillars[1], atol=1e-6)
        push = random.integers(0, 9, NUM_WORLDS)
        batches = pool.step(act(push, random.uniform(-1, 1, (NUM_WORLDS, 2)).astype(np.float32)))


def test_a_catch_is_the_chasers_round_and_the_time_limit_the_runners(pool: EnginePool) -> None:
    hunted, random = play(pool, 300, is_hunted=True), play(pool, 401, is_hunted=False)
    returns = np.array(hunted.returns + random.returns)
    lengths = np.array(hunted.lengths + random.lengths)
    gaps = np.array(hunted.last + random.last)[:, GAP] * SIDE * np.sqrt(2)
    is_caught = gaps < CATCH_GAP
    assert is_caught.sum() > 10 and (~is_caught).sum() > 10, "both happen"
    assert returns[is_caught].min() > 0.7 and returns[~is_caught].max() < -0.7
    assert lengths[is_caught].max() <= ROUND_STEPS
    assert set(lengths[~is_caught]) == {ROUND_STEPS}
    assert np.abs(returns).max() < 1.3


def test_a_hunter_beats_a_runner_that_stands_in_the_open(pool: EnginePool) -> None:
    hunted = play(pool, 300, is_hunted=True)
    assert np.mean(np.array(hunted.returns) > 0) > 0.5


def test_the_clock_runs_out_and_is_seen(pool: EnginePool) -> None:
    batches = pool.reset(2, {"time_limit": 1.0})
    stand = act(np.full(NUM_WORLDS, STAND), np.zeros((NUM_WORLDS, 2), np.float32))
    for step in range(20):
        np.testing.assert_allclose(seen(batches, "runner")[:, TIME_LEFT], 1 - step / 20, atol=1e-6)
        assert not batches["runner"].terminated.any()
        batches = pool.step(stand)
    assert batches["runner"].terminated.all() and batches["chaser"].terminated.all()
    np.testing.assert_array_equal(batches["runner"].reward, 1.0)
    assert not batches["runner"].final_observation["observation"][:, TIME_LEFT].any()
    np.testing.assert_array_equal(seen(batches, "chaser")[:, TIME_LEFT], 1.0)
    pool.reset(2, {})


def test_equal_seeds_are_equal_rounds_and_others_are_not(pool: EnginePool) -> None:
    first = seen(pool.reset(7), "chaser").copy()
    np.testing.assert_array_equal(seen(pool.reset(7), "chaser"), first)
    later = seen(pool.reset(8), "chaser")
    np.testing.assert_array_equal(later[:-1], first[1:])
    assert len(np.unique(first, axis=0)) == NUM_WORLDS
