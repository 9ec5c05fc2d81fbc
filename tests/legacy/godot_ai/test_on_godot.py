"""A game in real Godot learns from the server, over the wire of godot-ai."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from ludus.engine import EngineKind, EngineProcess, LaunchConfig, find_engine
from tests.legacy.godot_ai.conftest import Start

pytestmark = [pytest.mark.engine, pytest.mark.games]

SCRIPT = Path(__file__).with_name("point_to_goal.gd")
ROUNDS = 9
TIMEOUT_S = 120.0


def test_a_game_learns(start: Start, project: Path) -> None:
    running = start()
    shutil.copy(SCRIPT, project)
    program = str(find_engine(EngineKind.GODOT4).executable(headless=True))
    script = f"res://{SCRIPT.name}"
    command = (program, "--headless", "--path", str(project), "-s", script)
    arguments = ("--", str(running.port), str(ROUNDS))
    with EngineProcess.start(LaunchConfig(command=(*command, *arguments))) as game:
        code = game.wait(TIMEOUT_S)
        assert code == 0, game.describe_death()
        assert game.script_errors == []
    folder = project / "AIServerCommFiles"
    scores = json.loads((folder / "scores.json").read_text())["scores"]
    assert len(scores) == ROUNDS + 1
    first, last = scores[0], scores[-1]
    assert abs(first) < 0.35, "a net that has learnt nothing goes nowhere"
    assert last > 0.7, f"1.3 is straight to the goal, for as long as that takes: {scores}"
    assert (folder / "point.ludus.json").is_file()
