"""What an environment of Gymnasium gets wrong is told as an error of the game."""

from __future__ import annotations

from typing import Any, cast

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.envs.registration import EnvSpec

import ludus
from ludus.errors import GameError
from ludus.spec.batch import ActionBatch

WRONG: dict[str, tuple[Any, Any, str]] = {
    "reward": (np.zeros(2), np.nan, "agent: world 1, agent env: reward is nan at step 3"),
    "number": (np.array([0.0, np.inf]), 0.0, r'observation\["observation"\]\[1\] is inf at step 3'),
    "shape": (np.zeros(4), 0.0, "world 1: what the environment observes does not fit"),
    "kind": ("left", 0.0, "world 1: what the environment observes does not fit"),
}


class Wrong(gymnasium.Env[Any, Any]):
    """The second one of two is wrong in its third step."""

    observation_space = spaces.Box(-1.0, 1.0, (2,), np.float64)
    action_space = spaces.Discrete(2)
    num_made = 0

    def __init__(self, case: str) -> None:
        self._case, self._index, self._num_steps = case, Wrong.num_made, 0
        Wrong.num_made += 1

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        return np.zeros(2), {}

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        self._num_steps += 1
        is_wrong = self._index == 1 and self._num_steps == 3
        observation, reward, _ = WRONG[self._case] if is_wrong else (np.zeros(2), 0.0, "")
        return observation, reward, False, False, {}


@pytest.mark.parametrize("case", WRONG)
def test_what_an_environment_gets_wrong_is_named(
    case: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Wrong, "num_made", 0)
    monkeypatch.setitem(
        cast(Any, gymnasium).registry, "Wrong-v0",
        EnvSpec("Wrong-v0", cast(Any, Wrong), kwargs={"case": case}),
    )  # fmt: skip
    with ludus.open_pool("gym:Wrong-v0", ludus.PoolConfig(num_worlds=2)) as pool:
        batches = pool.reset(seed=0)
        actions = {"agent": ActionBatch.zeros(pool.spec.policies[0], 2)}
        for _ in range(2):
            batches = pool.step(actions)
        assert batches["agent"].reward.tolist() == [0.0, 0.0]
        with pytest.raises(GameError, match=WRONG[case][2]):
            pool.step(actions)
