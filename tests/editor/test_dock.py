"""The panel "Ludus" of the editor: from a check to a trained policy in the scene."""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import pytest

from ludus.runs.run_folder import RunFolder
from tests.editor.conftest import Look, processes_of
from tests.record.games import frames_of

pytestmark = [pytest.mark.editor, pytest.mark.engine, pytest.mark.screen, pytest.mark.timeout(420)]

END_S = 30.0

FROM_CHECK_TO_POLICY = """\
func look() -> void:
	await open()
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
	result["runs"] = dock.runs.item_count
	await run("Evaluate")
	result["evaluate"] = dock.output.get_parsed_text()
	await run("Use policy")
	await shoot("policy")
	result["use"] = dock.output.get_parsed_text()
	var agent: LudusAgent = EditorInterface.get_edited_scene_root().find_child("LudusAgent")
	result["misfit"] = agent.policy.incompatibility(agent) if agent.policy != null else "no policy"
	EditorInterface.save_scene()
	var undo_redo := plugin.get_undo_redo()
	var history := undo_redo.get_object_history_id(agent)
	undo_redo.get_history_undo_redo(history).undo()
	result["undone"] = agent.policy == null
"""


def test_from_a_check_to_a_policy_in_the_scene(project: Path, look: Look) -> None:
    result = look(FROM_CHECK_TO_POLICY)
    assert result["place"] == f"Python: {sys.executable}"
    assert "passed (" in result["check"], result["check"]
    assert "check has ended\n" in result["check"]
    assert result["returns"].keys() == {"player"}
    assert result["runs"] == 1
    assert result["frames"] > 20, "the editor goes on meanwhile"
    (run,) = (project / "runs").glob("game-*")
    assert RunFolder(run).read_config().total_steps == 6000
    assert "train has ended\n" in result["train"], result["train"]
    assert "evaluate has ended\n" in result["evaluate"], result["evaluate"]
    assert "agent Player/LudusAgent plays res://policies/player.ludus.json now" in result["use"]
    assert result["misfit"] == ""
    assert result["undone"] is True
    scene = (project / "game.tscn").read_text()
    assert 'path="res://policies/player.ludus.json"' in scene
    assert str(project) not in scene, "no path of this machine"


FILM_AND_PLAY = """\
func look() -> void:
	await open()
	dock.steps.value = 1000
	dock.flags.text = QUICK
	await run("Train")
	await run("Film")
	result["film"] = dock.output.get_parsed_text()
	dock.buttons["Play"].pressed.emit()
	await wait(func() -> bool: return "episode 1" in dock.output.get_parsed_text())
	await run("Stop")
	result["play"] = dock.output.get_parsed_text()
"""


def test_a_run_is_filmed_and_played_in_a_window(project: Path, look: Look) -> None:
    result = look(FILM_AND_PLAY)
    assert "record has ended\n" in result["film"], result["film"]
    (film,) = (project / "films").glob("*.mp4")
    assert len(frames_of(film)) > 100
    assert "player: episode 1" in result["play"], result["play"]
    assert "play has ended" in result["play"], result["play"]


STOP = """\
func look() -> void:
	await open()
	dock.steps.value = 100000000
	dock.flags.text = QUICK
	dock.buttons["Train"].pressed.emit()
	await wait(func() -> bool: return dock.curve.agent_steps > 0.0)
	result["buttons"] = [dock.buttons["Train"].disabled, dock.buttons["Stop"].disabled]
	await run("Stop")
	result["output"] = dock.output.get_parsed_text()
"""


def test_training_that_is_stopped_is_saved(project: Path, look: Look) -> None:
    result = look(STOP)
    assert result["buttons"] == [True, False], "one command at a time"
    assert "go on with: ludus train --resume" in result["output"], result["output"]
    (run,) = (project / "runs").glob("game-*")
    _, checkpoint = RunFolder(run).checkpoints().newest()
    assert checkpoint.agent_steps > 0


QUIT = """\
func look() -> void:
	await open()
	dock.steps.value = 100000000
	dock.flags.text = QUICK
	dock.buttons["Train"].pressed.emit()
	await wait(func() -> bool: return dock.curve.agent_steps > 0.0)
"""


def test_no_process_stays_when_the_editor_quits(project: Path, look: Look) -> None:
    look(QUIT)
    deadline = time.monotonic() + END_S
    while (left := processes_of(project)) and time.monotonic() < deadline:
        time.sleep(0.2)
    assert left == []
    (run,) = (project / "runs").glob("game-*")
    lines = (run / "metrics.jsonl").read_text().splitlines()
    assert json.loads(lines[-1])["agent_steps"] > 0
    _, checkpoint = RunFolder(run).checkpoints().newest()
    assert checkpoint.agent_steps > 0, "what was learnt is kept"


LINKS = """\
func look() -> void:
	await open()
	dock.output.open_place("res://player.gd:9")
	await tree.process_frame
	result["script"] = EditorInterface.get_script_editor().get_current_script().resource_path
	var code := EditorInterface.get_script_editor().get_current_editor().get_base_editor()
	result["line"] = (code as CodeEdit).get_caret_line()
	dock.output.open_place("agent Player/LudusAgent")
	var names := []
	for node: Node in EditorInterface.get_selection().get_selected_nodes():
		names.append(node.name)
	result["selected"] = names
	await run("Check")
	result["output"] = dock.output.get_parsed_text()
"""


def test_what_a_check_names_can_be_opened(project: Path, look: Look) -> None:
    script = project / "player.gd"
    text = script.read_text()
    assert "func is_done() -> bool:" in text
    script.write_text(text.replace("func is_done() -> bool:", "func is_doen() -> bool:"))
    result = look(LINKS)
    assert (result["script"], result["line"]) == ("res://player.gd", 8)
    assert result["selected"] == ["LudusAgent"]
    said = "agent Player/LudusAgent: Player (res://player.gd) has no method is_done()"
    assert said in result["output"], result["output"]
    assert "exit code" in result["output"]


NO_PYTHON = """\
func look() -> void:
	EditorInterface.open_scene_from_path("res://game.tscn")
	dock = find_dock(EditorInterface.get_base_control())
	plugin.make_bottom_panel_item_visible(dock)
	await wait(func() -> bool: return dock._place.text.begins_with("/bin/false"))
	result["place"] = dock._place.text
	result["is_off"] = dock.buttons["Train"].disabled
"""


def test_it_says_where_there_is_no_python_with_ludus(look: Look) -> None:
    result = look(NO_PYTHON, python="/bin/false")
    assert result["place"].startswith("/bin/false has no Ludus; run `/bin/false -m pip install")
    assert result["is_off"] is True


ENVIRONMENT = """\
func look() -> void:
	await open()
	result["is_offered"] = dock.environment.visible
	dock.environment.pressed.emit()
	await wait(func() -> bool: return dock.environment.question.visible)
	result["question"] = dock.environment.question.dialog_text
	await wait(func() -> bool: return not dock.command.is_running())
	dock.environment.question.confirmed.emit()
	await wait(func() -> bool: return DirAccess.dir_exists_absolute(VENV))
	result["is_begun"] = DirAccess.dir_exists_absolute(VENV)
	await run("Stop")
	result["is_left"] = DirAccess.dir_exists_absolute(VENV)
	result["is_offered_again"] = dock.environment.visible
"""


def test_an_environment_is_offered_with_its_size_and_taken_back(
    project: Path, look: Look, tmp_path: Path
) -> None:
    installer = tmp_path / "config" / "ludus" / "python"
    installer.parent.mkdir(parents=True)
    installer.write_text(f"{sys.executable}\n")
    result = look(ENVIRONMENT.replace("VENV", f'"{project}/.venv"'))
    assert result["is_offered"] is True
    assert " takes about " in result["question"], result["question"]
    assert result["is_begun"] is True
    assert result["is_left"] is False
    assert result["is_offered_again"] is True
