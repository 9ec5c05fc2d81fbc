"""The panel "Ludus" of the editor: from a check to a trained policy in the scene.

One editor does all of it, as its start and each training take long on a processor that also draws.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from ludus.runs.run_folder import RunFolder
from tests.editor.conftest import Look, processes_of
from tests.record.games import frames_of

pytestmark = [pytest.mark.editor, pytest.mark.engine, pytest.mark.screen, pytest.mark.timeout(420)]

END_S = 30.0

FROM_CHECK_TO_POLICY = """\
func check_and_train() -> void:
	result["place"] = dock._place.text
	await run("Check")
	result["check"] = dock.output.get_parsed_text()
	await shoot("check")
	dock.steps.value = 6000
	dock.flags.text = QUICK
	var frames := Engine.get_process_frames()
	dock.buttons["Train"].pressed.emit()
	await wait(func() -> bool: return dock.curve.agent_steps > 3000.0)
	await shoot("train")
	await wait(func() -> bool: return not dock.command.is_running())
	result["frames"] = Engine.get_process_frames() - frames
	result["train"] = dock.output.get_parsed_text()
	result["returns"] = dock.curve.last_returns()
	result["run"] = dock.runs.chosen_folder()

func use_run() -> void:
	await run("Evaluate")
	result["evaluate"] = dock.output.get_parsed_text()
	await run("Use policy")
	await shoot("policy")
	result["use"] = dock.output.get_parsed_text()
	var agent: LudusAgent = EditorInterface.get_edited_scene_root().find_child("LudusAgent")
	result["misfit"] = agent.policy.incompatibility(agent) if agent.policy != null else "no policy"
	EditorInterface.save_scene()
	result["scene"] = FileAccess.get_file_as_string("res://game.tscn")
	var undo_redo := plugin.get_undo_redo()
	var history := undo_redo.get_object_history_id(agent)
	undo_redo.get_history_undo_redo(history).undo()
	result["undone"] = agent.policy == null

"""
FILM_AND_PLAY = """\
func film_and_play() -> void:
	await run("Film")
	result["film"] = dock.output.get_parsed_text()
	dock.buttons["Play"].pressed.emit()
	await wait(func() -> bool: return "episode 1" in dock.output.get_parsed_text())
	await run("Stop")
	result["play"] = dock.output.get_parsed_text()

"""
STOP_AND_QUIT = """\
func train_long() -> void:
	dock.steps.value = 100000000
	dock.buttons["Train"].pressed.emit()
	await wait(func() -> bool: return dock.curve.agent_steps > 0.0)

func stop_and_quit() -> void:
	await train_long()
	result["buttons"] = [dock.buttons["Train"].disabled, dock.buttons["Stop"].disabled]
	await run("Stop")
	result["stop"] = dock.output.get_parsed_text()
	result["stopped run"] = dock.runs.chosen_folder()
	await train_long()
	result["last run"] = dock.curve.run_name()

"""
LOOK = """\
func look() -> void:
	await open()
	await check_and_train()
	await use_run()
	await film_and_play()
	await stop_and_quit()
"""


@pytest.fixture(scope="module")
def seen(look: Look) -> dict[str, Any]:
    return look(FROM_CHECK_TO_POLICY + FILM_AND_PLAY + STOP_AND_QUIT + LOOK)


def test_no_process_stays_when_the_editor_quits(project: Path, seen: dict[str, Any]) -> None:
    deadline = time.monotonic() + END_S
    while (left := processes_of(project)) and time.monotonic() < deadline:
        time.sleep(0.2)
    assert left == []
    run = project / "runs" / seen["last run"]
    lines = (run / "metrics.jsonl").read_text().splitlines()
    assert json.loads(lines[-1])["agent_steps"] > 0
    _, checkpoint = RunFolder(run).checkpoints().newest()
    assert checkpoint.agent_steps > 0, "what was learnt is kept"


def test_a_check_passes_and_training_shows_its_returns(seen: dict[str, Any]) -> None:
    assert seen["place"] == f"Python: {sys.executable}"
    assert "passed (" in seen["check"], seen["check"]
    assert "check has ended\n" in seen["check"]
    assert "train has ended\n" in seen["train"], seen["train"]
    assert seen["returns"].keys() == {"player"}
    assert seen["frames"] > 20, "the editor goes on meanwhile"
    assert RunFolder(Path(seen["run"])).read_config().total_steps == 6000


def test_a_run_gives_the_scene_its_policy(project: Path, seen: dict[str, Any]) -> None:
    assert "evaluate has ended\n" in seen["evaluate"], seen["evaluate"]
    assert "agent Player/LudusAgent plays res://policies/player.ludus.json now" in seen["use"]
    assert seen["misfit"] == ""
    assert seen["undone"] is True
    assert 'path="res://policies/player.ludus.json"' in seen["scene"]
    assert str(project) not in seen["scene"], "no path of this machine"


def test_a_run_is_filmed_and_played_in_a_window(project: Path, seen: dict[str, Any]) -> None:
    assert "record has ended\n" in seen["film"], seen["film"]
    (film,) = (project / "films").glob("*.mp4")
    assert len(frames_of(film)) > 100
    assert "player: episode 1" in seen["play"], seen["play"]
    assert "play was stopped\n" in seen["play"], seen["play"]


def test_training_that_is_stopped_is_saved(seen: dict[str, Any]) -> None:
    assert seen["buttons"] == [True, False], "one command at a time"
    assert "go on with: ludus train --resume" in seen["stop"], seen["stop"]
    assert "train was stopped\n" in seen["stop"], seen["stop"]
    _, checkpoint = RunFolder(Path(seen["stopped run"])).checkpoints().newest()
    assert checkpoint.agent_steps > 0
