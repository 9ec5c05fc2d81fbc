"""The examples "find_coin" and "zombies" by the rules of godot-ai's games, in real Godot."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from ludus.pool import EnginePool, PoolConfig, open_pool
from ludus.spec.batch import ActionBatch, Batch
from ludus.target import parse_target

pytestmark = pytest.mark.engine

SIZES = {"find_coin": {"hero": 251, "target": 251}, "zombies": {"soldier": 570, "zombie": 548}}
SCORES = {
    "find_coin": {"hero": -1.0, "target": 1.0},
    "zombies": {"soldier": -1.0, "zombie": -10.0},
}
"""What a step brings in which nobody is found or hurt."""


@pytest.mark.parametrize("example", ["find_coin", "zombies"])
def test_a_scene_with_these_rules_is_played(example: str) -> None:
    target = parse_target(example, scene=f"res://examples/{example}/original.tscn")
    with open_pool(target, PoolConfig(num_worlds=4)) as pool:
        assert {
            name: policy.observation[0].shape[0] for name, policy in pool.policies.items()
        } == SIZES[example]
        rounds = [play(pool, example, seed) for seed in (3, 3, 4)]
    for name in SIZES[example]:
        first, again, other = (played[name] for played in rounds)
        np.testing.assert_array_equal(first, again)
        assert not np.array_equal(first, other)
        assert np.all(np.abs(first) <= 1.0)


def play(pool: EnginePool, example: str, seed: int) -> dict[str, NDArray[np.float32]]:
    """Play half a round at random, and return all observations."""
    rng = np.random.default_rng(seed)
    seen = {name: [observed(batch)] for name, batch in pool.reset(seed).items()}
    for step in range(30):
        actions: dict[str, ActionBatch] = {}
        for name, policy in pool.policies.items():
            actions[name] = ActionBatch.zeros(policy, policy.num_agents)
            moves = rng.uniform(-1, 1, (policy.num_agents, policy.continuous_size))
            actions[name].continuous[:] = moves  # pyright: ignore[reportOptionalSubscript]
        for name, batch in pool.step(actions).items():
            seen[name].append(observed(batch))
            if step == 0:
                assert set(batch.reward.tolist()) == {SCORES[example][name]}
    return {name: np.stack(each) for name, each in seen.items()}


def observed(batch: Batch) -> NDArray[np.float32]:
    return batch.observation["observation"].copy()
