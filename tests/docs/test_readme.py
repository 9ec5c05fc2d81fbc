"""What the README tells a newcomer to write works as it stands there."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

import ludus
from tests.godot_project import write_project

pytestmark = pytest.mark.engine
ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text()


def block(language: str) -> str:
    found = re.search(rf"```{language}\n(.*?)```", README, re.DOTALL)
    assert found is not None
    return found[1]


def test_a_game_made_as_told_is_an_environment(tmp_path: Path) -> None:
    page = (ROOT / "docs/godot.md").read_text()
    (scene,) = re.findall(r"```\n(\[gd_scene.*?)```", page, re.DOTALL)
    files = {"player.tscn": scene, "player.gd": block("gdscript")}
    write_project(tmp_path, files, main="player")
    env = ludus.make(tmp_path)
    observation, _ = env.reset(seed=0)
    assert abs(observation[0]) <= 100.0 / 500.0
    terminated, num_steps = False, 0
    while not terminated and num_steps < 200:
        num_steps += 1
        observation, reward, terminated, _, _ = env.step(1)
        assert observation[1] == 1.0
        assert reward == (1.0 if observation[0] > 400.0 / 500.0 else 0.0)
    assert terminated and observation[0] > 1.0, f"after {num_steps} steps at {observation[0]}"
    env.close()


def test_the_python_lines_run() -> None:
    code = block("python")
    assert "range(1000)" in code
    names: dict[str, object] = {}
    exec(code.replace("range(1000)", "range(50)"), names)
    rewards = names["rewards"]
    assert np.shape(cast(Any, rewards)) == (128,)
