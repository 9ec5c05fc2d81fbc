"""What the editor shows before anything is trained: spaces, links, and where Python is."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.editor.conftest import Look

pytestmark = [pytest.mark.editor, pytest.mark.engine, pytest.mark.screen, pytest.mark.timeout(420)]

SPACES = """\
func summary() -> Label:
	return EditorInterface.get_inspector().find_child("LudusSpaces", true, false)

func look_at_spaces() -> void:
	var agent: LudusAgent = EditorInterface.get_edited_scene_root().find_child("LudusAgent")
	EditorInterface.edit_node(agent)
	await wait(func() -> bool: return summary() != null, 20.0)
	await shoot("inspector")
	result["spaces"] = summary().text
	var rays: LudusRays2D = EditorInterface.get_edited_scene_root().get_node("Player/Walls")
	var before := [rays.count, agent.action[0].low]
	rays.count = 5
	agent.action[0].low = 3.0
	await wait(func() -> bool: return "float32[5]" in summary().text, 20.0)
	result["changed"] = summary().text
	rays.count = before[0]
	agent.action[0].low = before[1]

"""
LINKS = """\
func misspell(name: String, wrong: String) -> void:
	var text := FileAccess.get_file_as_string("res://player.gd").replace(name, wrong)
	FileAccess.open("res://player.gd", FileAccess.WRITE).store_string(text)

func follow_links() -> void:
	misspell("is_done", "is_doen")
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
	await shoot("links")
	result["check"] = dock.output.get_parsed_text()

"""
ENVIRONMENT = """\
func make_environment() -> void:
	var folder := ProjectSettings.globalize_path("res://.venv")
	result["is_offered"] = dock.environment.visible
	dock.environment.pressed.emit()
	await wait(func() -> bool: return dock.environment.question.visible)
	await shoot("environment")
	result["question"] = dock.environment.question.dialog_text
	await wait(func() -> bool: return not dock.command.is_running())
	dock.environment.question.confirmed.emit()
	await wait(func() -> bool: return DirAccess.dir_exists_absolute(folder))
	result["is_begun"] = DirAccess.dir_exists_absolute(folder)
	await run("Stop")
	result["is_left"] = DirAccess.dir_exists_absolute(folder)
	result["is_offered_again"] = dock.environment.visible

"""
NO_PYTHON = """\
func look_for_python_in_vain() -> void:
	# The panel looks again by itself once an environment was made or not.
	await wait(func() -> bool: return dock._place.text.begins_with("Python: "))
	OS.set_environment("LUDUS_PYTHON", "/bin/false")
	dock.find_python()
	await wait(func() -> bool: return dock._place.text.begins_with("/bin/false"))
	await tree.process_frame
	result["place"] = dock._place.text
	result["is_off"] = dock.buttons["Train"].disabled

"""
LOOK = """\
func look() -> void:
	await open()
	await look_at_spaces()
	await follow_links()
	await make_environment()
	await look_for_python_in_vain()
"""


@pytest.fixture(scope="module")
def seen(look: Look) -> dict[str, Any]:
    return look(SPACES + LINKS + ENVIRONMENT + NO_PYTHON + LOOK)


def test_an_agent_shows_its_spaces_and_what_does_not_fit(seen: dict[str, Any]) -> None:
    assert "move  float32[2]  -1.0 to 1.0" in seen["spaces"]
    assert "⚠" not in seen["spaces"]
    assert "float32[5]  0.0 to 1.0" in seen["changed"], seen
    assert "⚠ Action move: low must be below high" in seen["changed"], seen


def test_what_a_check_names_can_be_opened(seen: dict[str, Any]) -> None:
    assert (seen["script"], seen["line"]) == ("res://player.gd", 8)
    assert seen["selected"] == ["LudusAgent"]
    said = "agent Player/LudusAgent: Player (res://player.gd) has no method is_done()"
    assert said in seen["check"], seen["check"]
    assert "exit code" in seen["check"]


def test_an_environment_is_offered_with_its_size_and_taken_back(
    project: Path, seen: dict[str, Any]
) -> None:
    assert seen["is_offered"] is True
    assert " takes about " in seen["question"], seen["question"]
    assert seen["is_begun"] is True
    assert seen["is_left"] is False
    assert seen["is_offered_again"] is True
    assert not (project / ".venv").exists()


def test_it_says_where_there_is_no_python_with_ludus(seen: dict[str, Any]) -> None:
    assert seen["place"].startswith("/bin/false has no Ludus; run `/bin/false -m pip install")
    assert seen["is_off"] is True
