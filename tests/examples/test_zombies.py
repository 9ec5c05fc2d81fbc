"""The example "zombies" as a trainer sees it: a soldier, two zombies that share a policy."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from ludus.pool import EnginePool, PoolConfig, open_pool
from ludus.spec import ContinuousAction
from ludus.spec.batch import ActionBatch, Batch, Batches

pytestmark = pytest.mark.engine

NUM_WORLDS = 20
ROUND_STEPS = 75
NUM_RAYS = 13
SOLDIER_SENSES = 1 + 2 * NUM_RAYS + 7
ZOMBIE_SENSES = 1 + 3 * NUM_RAYS + 4
MAP_RADIUS = 250.0
# Numbers of the soldier's senses.
ROTATION, AHEAD, PLACE, HEALTH, PAIN = 0, 14, slice(27, 29), 29, 30
AMMUNITION, FIRE_DELAY, RELOAD_DELAY = 31, 32, 33
# Numbers of a zombie's senses.
ZOMBIE_PLACE, ZOMBIE_HEALTH = slice(40, 42), 42
BITE, HIT = 0.05, 0.35
SIZES = {"soldier": 5, "zombie": 3}
WIN = 28.0
"""Return of a soldier that has won: from −1 to 27."""


@pytest.fixture(scope="module")
def pool() -> Iterator[EnginePool]:
    with open_pool("zombies", PoolConfig(num_worlds=NUM_WORLDS)) as pool:
        yield pool


def seen(batch: Batch) -> NDArray[np.float32]:
    return batch.observation["observation"]


def health(numbers: NDArray[np.float32]) -> NDArray[np.float32]:
    """Undo the scaling of shares to −1 … 1."""
    return ((numbers + 1) / 2).astype(np.float32)


def act(soldier: NDArray[np.float32], zombies: NDArray[np.float32]) -> dict[str, ActionBatch]:
    return {
        name: ActionBatch(np.zeros((len(act), 0), np.int64), act.astype(np.float32))
        for name, act in (("soldier", soldier), ("zombie", zombies))
    }


def ways_to_soldier(batches: Batches) -> NDArray[np.float32]:
    """Return unit vectors, ``float32[worlds, 2 zombies, 2]``."""
    zombies = seen(batches["zombie"])[:, ZOMBIE_PLACE].reshape(NUM_WORLDS, 2, 2)
    way = seen(batches["soldier"])[:, None, PLACE] - zombies
    return way / np.maximum(np.linalg.norm(way, axis=2, keepdims=True), 1e-6)


def hunt(batches: Batches) -> NDArray[np.float32]:
    """Let zombies walk straight towards the soldier."""
    way = ways_to_soldier(batches).reshape(-1, 2)
    return np.concatenate([way, np.zeros((len(way), 1), np.float32)], axis=1)


def aim(batches: Batches) -> NDArray[np.float32]:
    """Let the soldier stand, turn to the nearest zombie that lives, and shoot."""
    soldier, zombies = seen(batches["soldier"]), seen(batches["zombie"])
    way = zombies[:, ZOMBIE_PLACE].reshape(NUM_WORLDS, 2, 2) - soldier[:, None, PLACE]
    gaps = np.linalg.norm(way, axis=2)
    gaps[health(zombies[:, ZOMBIE_HEALTH]).reshape(NUM_WORLDS, 2) == 0] = np.inf
    best = way[np.arange(NUM_WORLDS), gaps.argmin(axis=1)]
    still, shoot = np.zeros((NUM_WORLDS, 2)), np.ones((NUM_WORLDS, 1))
    angle = np.arctan2(best[:, 1:], best[:, :1]) / np.pi
    turn = wrapped(angle - soldier[:, [ROTATION]])
    return np.concatenate([still, turn, shoot, shoot], axis=1).astype(np.float32)


def wrapped(angles: NDArray[Any]) -> NDArray[Any]:
    """Bring fractions of π to −1 … 1."""
    return (angles + 1) % 2 - 1


def at_random(random: np.random.Generator) -> dict[str, ActionBatch]:
    return act(
        random.uniform(-1, 1, (NUM_WORLDS, 5)).astype(np.float32),
        random.uniform(-1, 1, (2 * NUM_WORLDS, 3)).astype(np.float32),
    )


def test_two_zombies_share_a_policy(pool: EnginePool) -> None:
    for name, senses in (("soldier", SOLDIER_SENSES), ("zombie", ZOMBIE_SENSES)):
        policy = pool.policies[name]
        assert [type(part) for part in policy.action] == [ContinuousAction]
        assert policy.continuous_size == SIZES[name]
        assert [entry.shape for entry in policy.observation] == [
            (senses + 10 * (senses + SIZES[name]),)
        ]
        assert policy.agents_per_world == (1 if name == "soldier" else 2)
        assert policy.max_episode_steps == ROUND_STEPS


def test_a_soldier_that_aims_beats_zombies_that_stand(pool: EnginePool) -> None:
    batches = pool.reset(3)
    returns, results = np.zeros(NUM_WORLDS), list[tuple[float, bool]]()
    for _ in range(3 * ROUND_STEPS):
        batches = pool.step(act(aim(batches), np.zeros((2 * NUM_WORLDS, 3), np.float32)))
        soldier = batches["soldier"]
        returns += soldier.reward
        assert not batches["zombie"].reward.any(), "nobody bites"
        for slot in soldier.final_index:
            results.append((float(returns[slot]), bool(soldier.terminated[slot])))
            returns[slot] = 0
    won = np.array([is_over for _, is_over in results])
    assert won.sum() > 10 and (~won).sum() > 0, "walls protect some"
    wins = np.array([total for total, _ in results])
    np.testing.assert_allclose(wins[won], WIN, atol=1e-4)
    assert wins[~won].max() < WIN - 10


def test_zombies_that_hunt_beat_a_soldier_that_stands(pool: EnginePool) -> None:
    batches = pool.reset(4)
    returns, results = np.zeros(2 * NUM_WORLDS), list[tuple[float, bool]]()
    for _ in range(3 * ROUND_STEPS):
        batches = pool.step(act(np.zeros((NUM_WORLDS, 5), np.float32), hunt(batches)))
        zombie = batches["zombie"]
        pairs = zombie.reward.reshape(NUM_WORLDS, 2)
        np.testing.assert_array_equal(pairs[:, 0], pairs[:, 1])
        returns += zombie.reward
        for slot in zombie.final_index:
            results.append((float(returns[slot]), bool(zombie.terminated[slot])))
            returns[slot] = 0
    won = np.array([is_over for _, is_over in results])
    assert won.sum() > 40
    np.testing.assert_allclose(np.array([total for total, _ in results])[won], 20.0, atol=1e-4)


def test_health_is_lost_in_bites_and_hits_and_felt_as_pain(pool: EnginePool) -> None:
    batches, num_bites = pool.reset(5), 0
    for _ in range(ROUND_STEPS - 1):
        before = health(seen(batches["soldier"])[:, HEALTH]).copy()
        batches = pool.step(act(np.zeros((NUM_WORLDS, 5), np.float32), hunt(batches)))
        soldier = batches["soldier"]
        goes_on = soldier.terminated == 0
        lost = (before - health(seen(soldier)[:, HEALTH]))[goes_on]
        np.testing.assert_allclose(lost / BITE, np.round(lost / BITE), atol=1e-3)
        assert lost.min() > -1e-6 and lost.max() < 2 * BITE + 1e-6
        np.testing.assert_allclose(health(seen(soldier)[goes_on, PAIN]), lost, atol=1e-6)
        num_bites += round(float(lost.sum()) / BITE)
    assert num_bites > 50


@pytest.mark.parametrize("rotation", ["turn", "angle"])
def test_rotation_is_a_turn_or_an_angle_of_the_room(pool: EnginePool, rotation: str) -> None:
    batches = pool.reset(8, {"rotation": rotation})
    random = np.random.default_rng(8)
    for _ in range(5):
        before = {name: seen(batches[name])[:, ROTATION].copy() for name in SIZES}
        actions = at_random(random)
        batches = pool.step(actions)
        for name, start in before.items():
            asked = actions[name].continuous[:, 2] + (start if rotation == "turn" else 0)
            error = wrapped(seen(batches[name])[:, ROTATION] - asked)
            goes_on = batches[name].terminated == 0
            np.testing.assert_allclose(error[goes_on], 0, atol=1e-5)


def test_a_shot_hits_what_the_middle_ray_saw(pool: EnginePool) -> None:
    batches, random = pool.reset(9), np.random.default_rng(9)
    num_hits, num_misses = 0, 0
    for _ in range(6 * ROUND_STEPS):
        before = seen(batches["soldier"]).copy()
        actions = at_random(random)
        # Wherever it turns and walks to: the shot comes first.
        actions["soldier"].continuous[:, 3] = 1.0
        batches = pool.step(actions)
        soldier = batches["soldier"]
        has_shot = (before[:, AMMUNITION] > -1) & (before[:, FIRE_DELAY] <= 0)
        has_shot &= (before[:, RELOAD_DELAY] == -1) & (soldier.truncated == 0)
        is_hit = soldier.reward > 0.01
        is_ahead = before[:, AHEAD] < 1
        assert not (is_hit & ~is_ahead).any()
        num_hits += int((has_shot & is_ahead & is_hit).sum())
        num_misses += int((has_shot & is_ahead & ~is_hit).sum())
    # A shot is thicker than a ray, so that a wall may catch it.
    assert num_hits > 20 and num_misses < num_hits / 4


def test_the_rifle_counts_its_shots_and_waits(pool: EnginePool) -> None:
    batches, random = pool.reset(6), np.random.default_rng(6)
    num_shots, num_reloaded = 0, 0
    for _ in range(2 * ROUND_STEPS):
        before, actions = seen(batches["soldier"]).copy(), at_random(random)
        is_asked = actions["soldier"].continuous[:, 3] > 0
        batches = pool.step(actions)
        goes_on = ~(batches["soldier"].terminated | batches["soldier"].truncated).astype(bool)
        now = seen(batches["soldier"])
        magazine = np.round(health(before[:, AMMUNITION]) * 20).astype(int)
        left = np.round(health(now[:, AMMUNITION]) * 20).astype(int)
        waits = np.round(health(before[:, FIRE_DELAY]) * 2).astype(int)
        reloads = np.round(health(before[:, RELOAD_DELAY]) * 10).astype(int)
        is_full = goes_on & (reloads == 1)
        may_shoot = (waits <= 1) & (reloads <= 1) & ((magazine > 0) | is_full)
        has_shot = goes_on & is_asked & may_shoot
        expected = np.where(is_full, 20, magazine) - has_shot
        np.testing.assert_array_equal(left[goes_on], expected[goes_on])
        num_shots += int(has_shot.sum())
        num_reloaded += int(is_full.sum())
    assert num_shots > 100 and num_reloaded > 50


def test_equal_seeds_are_equal_rounds_and_others_are_not(pool: EnginePool) -> None:
    for name in SIZES:
        first = seen(pool.reset(7)[name]).copy()
        np.testing.assert_array_equal(seen(pool.reset(7)[name]), first)
        num = len(first) // NUM_WORLDS
        later = seen(pool.reset(8)[name])
        np.testing.assert_array_equal(later[:-num], first[num:])
        assert len(np.unique(first, axis=0)) == len(first)
