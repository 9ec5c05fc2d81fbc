"""A small project of ours that speaks GymGodot's wire, in a real Godot 3."""

from __future__ import annotations

import shlex
import shutil
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

from ludus.engine import EngineKind, find_engine
from ludus.errors import GameError, LudusError
from tests.legacy.gymgodot.conftest import (
    Opener,
    left_processes,
)

pytestmark = pytest.mark.engine

SPACE = gymnasium.spaces.Box(-np.inf, np.inf, (3,), np.float32)
STEP = np.array([0.25], np.float32)


@pytest.fixture(scope="module")
def command(tmp_path_factory: pytest.TempPathFactory) -> str:
    """What a user would write as exeCmd; a machine without Godot 3 fails these tests."""
    folder = tmp_path_factory.mktemp("gymgodot") / "project"
    shutil.copytree(Path(__file__).with_name("project"), folder)
    program = find_engine(EngineKind.GODOT3).path
    return f"cd {shlex.quote(str(folder))} && {shlex.quote(str(program))} ./walk.tscn"


def opened(opener: Opener, command: str, **settings: Any) -> gymnasium.Env[Any, Any]:
    return opener.open(command, observation_space=SPACE, **settings)


def test_steps_are_exact(opener: Opener, command: str) -> None:
    env = opened(opener, command)
    for _ in range(2):
        observation, info = env.reset()
        assert (observation.tolist(), info) == ([0, 0, 0], {})
        for count in range(1, 7):
            place = 0.5 * count
            result = env.step(STEP)
            assert result[0].tolist() == [place, 2 * count, 2 * count]
            assert result[1:] == (place / 2, False, False, {})
        assert env.step(STEP)[2]


def test_failed_script_is_reported(opener: Opener, command: str) -> None:
    env = opened(opener, command.replace(" && ", " && WALK_FAULT=script "), step_timeout_s=30.0)
    env.reset()
    for _ in range(2):
        env.step(STEP)
    what = r"(?s)SCRIPT ERROR.*get_observation \(res://walk\.gd:"
    with pytest.raises(GameError, match=what):
        env.step(STEP)
    assert left_processes() == []


def test_frame_without_a_renderer_hints_at_one(opener: Opener, command: str) -> None:
    env = opened(opener, command, render_mode="rgb_array")
    env.reset()
    with pytest.raises(GameError, match="SCRIPT ERROR") as caught:
        env.render()
    assert "run godot3, not godot3-server" in caught.value.hint
    assert "xvfb-run" in caught.value.hint


def test_missing_scene_is_reported(opener: Opener, command: str) -> None:
    with pytest.raises(LudusError, match="Godot Engine v3"):
        opened(opener, command.replace("walk.tscn", "nowhere.tscn"), start_timeout_s=10.0)
    assert left_processes() == []
