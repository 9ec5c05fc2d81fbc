"""What the inspector says of an agent: its spaces, and why something does not fit."""

from __future__ import annotations

import pytest

from tests.editor.conftest import Look

pytestmark = [pytest.mark.editor, pytest.mark.engine, pytest.mark.screen, pytest.mark.timeout(420)]

SPACES = """\
func summary() -> Label:
	return EditorInterface.get_inspector().find_child("LudusSpaces", true, false)

func look() -> void:
	EditorInterface.open_scene_from_path("res://game.tscn")
	var agent: LudusAgent = EditorInterface.get_edited_scene_root().find_child("LudusAgent")
	EditorInterface.edit_node(agent)
	await wait(func() -> bool: return summary() != null, 20.0)
	await shoot("inspector")
	result["at first"] = summary().text
	var rays: LudusRays2D = EditorInterface.get_edited_scene_root().get_node("Player/Walls")
	rays.count = 5
	agent.action[0].low = 3.0
	await wait(func() -> bool: return "float32[5]" in summary().text, 20.0)
	result["changed"] = summary().text
"""


def test_an_agent_shows_its_spaces_and_what_does_not_fit(look: Look) -> None:
    result = look(SPACES)
    assert "move  float32[2]  -1.0 to 1.0" in result["at first"]
    assert "⚠" not in result["at first"]
    assert "float32[5]  0.0 to 1.0" in result["changed"], result
    assert "⚠ Action move: low must be below high" in result["changed"], result
