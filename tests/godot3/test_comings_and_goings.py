"""Agents that end early, leave and join inside an episode: the tests of Godot 4, on Godot 3."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from ludus.pool import PoolConfig, open_pool
from ludus.spec.batch import Batches
from tests.godot.test_comings_and_goings import (
    NUM_FRAMES,
    PARAMETERS,
    idle,
    test_a_world_that_lost_agents_is_made_anew,
    test_final_observations,
    test_inactive_slots_observe_zeros,
    test_who_ends_early_waits_for_its_world,
    test_who_leaves_is_reported_once_and_who_joins_is_seen_at_once,
)
from tests.targets import find_scene

__all__ = [
    "test_a_world_that_lost_agents_is_made_anew",
    "test_final_observations",
    "test_inactive_slots_observe_zeros",
    "test_who_ends_early_waits_for_its_world",
    "test_who_leaves_is_reported_once_and_who_joins_is_seen_at_once",
]

pytestmark = pytest.mark.engine


@pytest.fixture(scope="module", params=["isolated", "grid"])
def frames(request: pytest.FixtureRequest) -> Iterator[list[Batches]]:
    """Copies of all frames."""
    project = find_scene("godot3:cartpole").project
    scene = project.root / "examples/identity/oracle_world.tscn"
    with open_pool(scene, PoolConfig(num_worlds=2, layout=request.param)) as pool:
        taken = [pool.reset(1, PARAMETERS)]
        taken += [pool.step(idle(pool)) for _ in range(NUM_FRAMES - 1)]
        yield taken
