"""The example "find_coin" as a trainer sees it: a hero that seeks, a target that does not wait."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import pytest
from numpy.typing import NDArray

from ludus.pool import EnginePool, PoolConfig, open_pool
from ludus.spec import ContinuousAction
from ludus.spec.batch import ActionBatch, Batch, Batches

pytestmark = pytest.mark.engine

NUM_WORLDS = 32
ROUND_STEPS = 60
NUM_RAYS = 9
SENSES_SIZE = 1 + 2 * NUM_RAYS + 2
ROTATION, PLACE = 0, slice(SENSES_SIZE - 2, SENSES_SIZE)
WALLS, OTHER = slice(1, 1 + NUM_RAYS), slice(1 + NUM_RAYS, 1 + 2 * NUM_RAYS)
PAST_SENSES = slice(SENSES_SIZE, 11 * SENSES_SIZE)
PAST_ACTIONS = slice(11 * SENSES_SIZE, 11 * SENSES_SIZE + 20)
SIGHT, MAP_RADIUS, RADIUS = 700.0, 250.0, 20.0
CONTACT = 2 * RADIUS
STEP_LENGTHS = {"hero": 20.0, "target": 24.0}


@dataclass
class Rounds:
    """What many steps brought.

    Attributes:
        returns: Per finished round: the hero's return.
        lengths: Its steps.
        found: Whether it ended with a touch.
    """

    returns: list[float] = field(default_factory=list[float])
    lengths: list[int] = field(default_factory=list[int])
    found: list[bool] = field(default_factory=list[bool])


@pytest.fixture(scope="module")
def pool() -> Iterator[EnginePool]:
    with open_pool("find_coin", PoolConfig(num_worlds=NUM_WORLDS)) as pool:
        yield pool


def seen(batch: Batch) -> NDArray[np.float32]:
    return batch.observation["observation"]


def places(batches: Batches, policy: str) -> NDArray[np.float32]:
    return seen(batches[policy])[:, PLACE] * MAP_RADIUS


def act(hero: NDArray[np.float32], target: NDArray[np.float32]) -> dict[str, ActionBatch]:
    return {
        name: ActionBatch(np.zeros((len(move), 0), np.int64), move.astype(np.float32))
        for name, move in (("hero", hero), ("target", target))
    }


def at_random(random: np.random.Generator) -> NDArray[np.float32]:
    return random.uniform(-1, 1, (NUM_WORLDS, 2)).astype(np.float32)


def play(pool: EnginePool, num_steps: int) -> Rounds:
    """Play with a hero that knows the way, and a target that stands."""
    rounds, batches = Rounds(), pool.reset(5)
    returns, lengths = np.zeros(NUM_WORLDS), np.zeros(NUM_WORLDS, int)
    for _ in range(num_steps):
        way = places(batches, "target") - places(batches, "hero")
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        batches = pool.step(act(way, np.zeros_like(way)))
        hero, target = batches["hero"], batches["target"]
        np.testing.assert_array_equal(hero.reward, -target.reward)
        np.testing.assert_array_equal(hero.terminated, target.terminated)
        np.testing.assert_array_equal(hero.truncated, target.truncated)
        returns += hero.reward
        lengths += 1
        for slot in hero.final_index:
            rounds.returns.append(float(returns[slot]))
            rounds.lengths.append(int(lengths[slot]))
            rounds.found.append(bool(hero.terminated[slot]))
            returns[slot], lengths[slot] = 0, 0
    return rounds


def test_both_move_with_two_numbers_and_see_the_same_kind_of_thing(pool: EnginePool) -> None:
    for name in ("hero", "target"):
        policy = pool.policies[name]
        assert [type(part) for part in policy.action] == [ContinuousAction]
        assert policy.continuous_size == 2
        assert [entry.shape for entry in policy.observation] == [(21 + 10 * (21 + 2),)]
        assert policy.agents_per_world == 1
        assert policy.max_episode_steps == ROUND_STEPS
    assert pool.spec.ticks_per_step == 1


def test_returns_tell_whether_and_when_the_target_was_found(pool: EnginePool) -> None:
    rounds = play(pool, 250)
    returns, lengths = np.array(rounds.returns), np.array(rounds.lengths)
    found = np.array(rounds.found)
    assert found.sum() > 50 and (~found).sum() > 10, "walls are in the way now and then"
    np.testing.assert_array_equal(returns[found], 2 - lengths[found])
    np.testing.assert_array_equal(returns[~found], -ROUND_STEPS)
    np.testing.assert_array_equal(lengths[~found], ROUND_STEPS)
    # From at least a map's radius away to a touch, 20 pixels a step.
    assert lengths[found].min() >= (MAP_RADIUS - CONTACT) / STEP_LENGTHS["hero"]


def test_a_touch_is_in_the_final_observation(pool: EnginePool) -> None:
    batches = pool.reset(6)
    num_found = 0
    for _ in range(120):
        way = places(batches, "target") - places(batches, "hero")
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        batches = pool.step(act(way, np.zeros_like(way)))
        last = {name: batches[name].final_observation["observation"] for name in batches}
        is_found = batches["hero"].terminated[batches["hero"].final_index].astype(bool)
        gaps = np.linalg.norm(last["hero"][:, PLACE] - last["target"][:, PLACE], axis=1)
        gaps = gaps * MAP_RADIUS
        assert (gaps[is_found] <= CONTACT + 1e-3).all() and (gaps[~is_found] > CONTACT).all()
        for one in last.values():
            felt = np.repeat(0.2 * gaps[is_found, None] / SIGHT, NUM_RAYS, axis=1)
            np.testing.assert_allclose(one[is_found, OTHER], felt, atol=1e-5)
        num_found += int(is_found.sum())
    assert num_found > 20


def test_moves_are_what_was_asked_unless_a_wall_is_near(pool: EnginePool) -> None:
    batches, random = pool.reset(7), np.random.default_rng(7)
    num_free = 0
    for _ in range(ROUND_STEPS - 1):
        before = {name: places(batches, name).copy() for name in batches}
        moves = {name: at_random(random) for name in ("hero", "target")}
        batches = pool.step(act(moves["hero"], moves["target"]))
        goes_on = batches["hero"].terminated == 0
        for name, length in STEP_LENGTHS.items():
            moved = places(batches, name)[goes_on] - before[name][goes_on]
            asked = moves[name][goes_on] * length
            share = np.einsum("ij,ij->i", moved, asked) / np.einsum("ij,ij->i", asked, asked)
            assert share.min() > -1e-3 and share.max() < 1 + 1e-3
            np.testing.assert_allclose(moved, asked * share[:, None], atol=0.02)
            num_free += int((share > 0.999).sum())
            angle = np.arctan2(asked[:, 1], asked[:, 0]) / np.pi
            np.testing.assert_allclose(seen(batches[name])[goes_on, ROTATION], angle, atol=1e-5)
    assert num_free > 0.8 * 2 * NUM_WORLDS * (ROUND_STEPS - 1)


def test_what_was_seen_and_done_is_remembered(pool: EnginePool) -> None:
    batches, random = pool.reset(8), np.random.default_rng(8)
    assert not seen(batches["hero"])[:, SENSES_SIZE:].any()
    for _ in range(20):
        before, move = seen(batches["hero"]).copy(), at_random(random)
        batches = pool.step(act(move, at_random(random)))
        goes_on = batches["hero"].terminated == 0
        now = seen(batches["hero"])[goes_on]
        past = now[:, PAST_SENSES]
        np.testing.assert_array_equal(past, before[goes_on, : 10 * SENSES_SIZE])
        np.testing.assert_array_equal(now[:, PAST_ACTIONS][:, :2], move[goes_on])


def test_rays_never_see_through_walls(pool: EnginePool) -> None:
    batches, random = pool.reset(9), np.random.default_rng(9)
    num_seen = 0
    for _ in range(40):
        for name in batches:
            walls, other = seen(batches[name])[:, WALLS], seen(batches[name])[:, OTHER]
            is_seen = (other < 1) & (batches[name].active[:, None] == 1)
            assert (other[is_seen] < walls[is_seen]).all()
            num_seen += int(is_seen.sum())
        batches = pool.step(act(at_random(random), at_random(random)))
    assert num_seen > 100


def test_equal_seeds_are_equal_rounds_and_others_are_not(pool: EnginePool) -> None:
    first = seen(pool.reset(7)["hero"]).copy()
    np.testing.assert_array_equal(seen(pool.reset(7)["hero"]), first)
    later = seen(pool.reset(8)["hero"])
    np.testing.assert_array_equal(later[:-1], first[1:])
    assert len(np.unique(first, axis=0)) == NUM_WORLDS
