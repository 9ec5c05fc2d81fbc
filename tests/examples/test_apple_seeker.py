"""The example "apple_seeker", against geometry: what is seen, earned and ended at every step."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

from ludus.pool import EnginePool, PoolConfig, open_pool
from ludus.spec.batch import ActionBatch, Batch
from tests.apple_room import (
    DIRECTIONS,
    REACH,
    SIGHT,
    SPOTS,
    START,
    distances_to_furniture,
    seen_from,
)

pytestmark = pytest.mark.engine

NUM_WORLDS = 16
NUM_STEPS = 120
RADIUS = 0.35
MOVES = np.array([(1, 0), (-1, 0), (0, -1), (0, 1)]) * 5.0 * 4 / 60
FIRST_RAY = 12
"""The sensor's first ray points to -z, which is the twelfth of ``DIRECTIONS``."""

Places = NDArray[np.float64]


@pytest.fixture(scope="module")
def pool() -> Iterator[EnginePool]:
    with open_pool("apple_seeker", PoolConfig(num_worlds=NUM_WORLDS)) as pool:
        yield pool


def places(pool: EnginePool) -> Places:
    """Return x and z of robot and apple in every world."""
    agent = "Robot/Driver/LudusAgent"
    return np.array(
        [
            pool.call({"world": world, "agent": agent}, "ludus_places")[0]
            for world in range(NUM_WORLDS)
        ]
    )


def step(pool: EnginePool, actions: NDArray[np.int64]) -> Batch:
    nothing = np.zeros((NUM_WORLDS, 0), np.float32)
    return pool.step({"robot": ActionBatch(actions[:, np.newaxis], nothing)})["robot"]


def assert_seen(rays: NDArray[np.float32], place: Places) -> float:
    """Compare the rays of one robot with geometry; return the distance of the apple in metres."""
    obstacle, target = seen_from((place[0], place[1]), (place[2], place[3]))
    by_ray = rays.reshape(len(DIRECTIONS), 2)
    is_apple = np.roll(target, -FIRST_RAY) < SIGHT
    np.testing.assert_allclose(by_ray[:, 0] * SIGHT, np.roll(obstacle, -FIRST_RAY), atol=5e-3)
    np.testing.assert_array_equal(by_ray[:, 1] > 0, is_apple)
    return float(target.min())


def test_it_starts_where_the_rules_say(pool: EnginePool) -> None:
    apples: set[tuple[float, float]] = set()
    for seed in range(0, 4 * NUM_WORLDS, NUM_WORLDS):
        batch = pool.reset(seed)["robot"]
        for place, rays in zip(places(pool), batch.observation["Rays"], strict=True):
            assert np.abs(place[:2] - START).max() <= 0.3 + 1e-6
            assert_seen(rays, place)
            apples.add((round(place[2], 3), round(place[3], 3)))
    assert apples == set(SPOTS)


def test_every_step_follows_the_rules(pool: EnginePool) -> None:
    random = np.random.default_rng(3)
    pool.reset(7)
    actions = random.integers(0, 4, NUM_WORLDS)
    before = places(pool)
    num_caught = num_seen = num_stopped = 0
    for _ in range(NUM_STEPS):
        is_turning = random.random(NUM_WORLDS) < 0.3
        actions = np.where(is_turning, random.integers(0, 4, NUM_WORLDS), actions)
        batch = step(pool, actions)
        after = places(pool)
        for world, place in enumerate(after):
            goal = before[world, :2] + MOVES[actions[world]]
            if batch.terminated[world]:
                assert batch.reward[world] == 100.0
                assert np.hypot(*(goal - before[world, 2:])) <= REACH
                num_caught += 1
                continue
            nearest = assert_seen(batch.observation["Rays"][world], place)
            assert batch.reward[world] == pytest.approx(-nearest / SIGHT, abs=1e-3)
            assert np.hypot(*(place[:2] - place[2:])) > REACH
            assert distances_to_furniture((place[0], place[1])).min() > RADIUS - 0.01
            num_seen += nearest < SIGHT
            num_stopped += not np.allclose(place[:2], goal, atol=1e-3)
        before = after
    assert min(num_caught, num_seen, num_stopped) > 10


def test_spot_start_and_speed_are_parameters(pool: EnginePool) -> None:
    chosen = {"spot": 4, "start_offset": 0.0, "speed": 2.5}
    pool.reset(1, chosen)
    step(pool, np.full(NUM_WORLDS, 3))
    expected = (*(np.array(START) + MOVES[3] / 2), *SPOTS[4])
    np.testing.assert_allclose(places(pool), [expected] * NUM_WORLDS, atol=1e-4)
