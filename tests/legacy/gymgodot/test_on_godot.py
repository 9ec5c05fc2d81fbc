"""A small project of ours that speaks GymGodot's wire, in a real Godot 3."""

from __future__ import annotations

import os
import shlex
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import psutil
import pytest

from ludus.engine import EngineKind, find_engine
from ludus.errors import EngineCrashed, EngineError, EngineTimeout, GameError, LudusError
from tests.legacy.gymgodot.conftest import (
    ROOT,
    Opener,
    left_processes,
    running_game,
    started_processes,
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


def test_several_games_at_once(opener: Opener, command: str) -> None:
    envs = [opened(opener, command) for _ in range(2)]
    for env in envs:
        env.reset()
    for _ in range(19):
        for number, env in enumerate(envs):
            env.step(np.array([0.01 * number]))
    places = [float(env.step(np.zeros(1))[0][0]) for env in envs]
    assert places == pytest.approx([0.0, 0.38])


def test_close_ends_the_game(opener: Opener, command: str) -> None:
    env = opened(opener, command)
    env.reset()
    assert len(started_processes()) >= 2
    began = time.monotonic()
    env.close()
    assert left_processes() == []
    assert time.monotonic() - began < 5.0


OPEN_AND_WAIT = """
import sys
from tests.legacy.gymgodot.conftest import Opener
from tests.legacy.gymgodot.test_on_godot import opened
env = opened(Opener(), sys.argv[1])
env.reset()
print("ready", flush=True)
sys.stdin.read()
"""


def test_the_game_goes_with_its_trainer(opener: Opener, command: str) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", OPEN_AND_WAIT, command],
        cwd=ROOT,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as trainer:
        assert trainer.stdout is not None
        assert trainer.stdout.readline() == "ready\n"
        games = psutil.Process(trainer.pid).children(recursive=True)
        assert len(games) >= 2
        trainer.kill()
    assert psutil.wait_procs(games, timeout=30.0)[1] == []


@pytest.mark.parametrize(
    ("fault", "kind", "what"),
    [
        ("script", GameError, r"(?s)SCRIPT ERROR.*get_observation \(res://walk\.gd:"),
        ("nan", GameError, r"observation does not fit observation_space: nan at \[0\]"),
        ("inf", GameError, "the reward is -inf"),
        ("hang", EngineTimeout, "did not answer .*step.* within 4 s"),
    ],
)
def test_a_game_that_goes_wrong(
    opener: Opener, command: str, fault: str, kind: type[EngineError], what: str
) -> None:
    command = command.replace(" && ", f" && WALK_FAULT={fault} ")
    env = opened(opener, command, step_timeout_s=4.0)
    env.reset()
    for _ in range(2):
        env.step(STEP)
    with pytest.raises(kind, match=what):
        env.step(STEP)
    assert left_processes() == []


def test_a_game_that_quits(opener: Opener, command: str) -> None:
    env = opened(opener, command.replace(" && ", " && WALK_FAULT=quit "))
    env.reset()
    with pytest.raises(EngineCrashed, match="exit code 9"):
        for _ in range(5):
            env.step(STEP)


def test_a_killed_game(opener: Opener, command: str) -> None:
    env = opened(opener, command)
    env.reset()
    os.kill(running_game().pid, signal.SIGKILL)
    with pytest.raises(EngineCrashed, match="Godot Engine v3"):
        for _ in range(5):
            env.step(STEP)
    assert left_processes() == []


def test_a_frame_without_a_renderer(opener: Opener, command: str) -> None:
    env = opened(opener, command, render_mode="rgb_array")
    env.reset()
    with pytest.raises(GameError, match="SCRIPT ERROR") as caught:
        env.render()
    assert "run godot3, not godot3-server" in caught.value.hint
    assert "xvfb-run" in caught.value.hint


def test_a_scene_that_is_missing(opener: Opener, command: str) -> None:
    with pytest.raises(LudusError, match="Godot Engine v3"):
        opened(opener, command.replace("walk.tscn", "nowhere.tscn"), start_timeout_s=10.0)
    assert left_processes() == []
