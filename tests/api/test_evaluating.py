"""``ludus.evaluate``: who plays, and in which game."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import ludus
from ludus.errors import CheckpointError, ConfigError, TargetError

TARGET = "gym:Identity-discrete-v0"


@pytest.fixture
def run(tmp_path: Path) -> ludus.Run:
    return ludus.train(
        TARGET, runs=tmp_path, name="run", num_worlds=4, num_engines=1, seed=3, total_steps=1280,
        evaluation_episodes=0, ppo={"rollout_steps": 16, "hidden_sizes": [16]},
    )  # fmt: skip


def test_a_run_a_file_and_a_pool_give_the_same_episodes(run: ludus.Run) -> None:
    (file,) = run.export(parity=False).values()
    size: dict[str, Any] = {"episodes": 8, "num_worlds": 4}
    of_run = ludus.evaluate(run.path, **size)["agent"]
    assert of_run.num_episodes == 8
    assert ludus.evaluate(TARGET, file, **size)["agent"].returns == of_run.returns
    assert ludus.evaluate(TARGET, [run.path], **size)["agent"].returns == of_run.returns
    with ludus.open_pool(TARGET, ludus.PoolConfig(num_worlds=4)) as pool:
        assert ludus.evaluate(run.path, episodes=8, pool=pool)["agent"].returns == of_run.returns


def test_chance_is_a_baseline_for_any_game(run: ludus.Run) -> None:
    chance = ludus.evaluate(TARGET, "random", episodes=40, num_worlds=4)["agent"]
    assert 1 < chance.mean_return < 3  # of 8 guesses among 4
    assert ludus.evaluate(run.path, "random", episodes=4)["agent"].num_episodes == 4


def test_what_cannot_be_played_is_an_error(run: ludus.Run) -> None:
    with pytest.raises(ConfigError, match="is a game, and nothing was named that plays it"):
        ludus.evaluate(TARGET)
    with pytest.raises(ConfigError, match="episodes must be at least 1, not 0"):
        ludus.evaluate(run.path, episodes=0)
    with pytest.raises(ConfigError, match="unknown setting num_world"):
        ludus.evaluate(run.path, num_world=3)
    with pytest.raises(TargetError):
        ludus.evaluate("no_such_game", "random")
    with pytest.raises(CheckpointError, match="trained for other observations"):
        ludus.evaluate("gym:Identity-continuous-v0", run.path)
