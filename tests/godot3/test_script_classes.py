"""The list of named scripts in the project file of a Godot 3 project."""

from __future__ import annotations

from pathlib import Path

import pytest

from ludus.engine import EngineKind
from ludus.engine.bundled import runnable_bundled_root
from ludus.engine.config_file import parse_config
from ludus.engine.script_classes import ScriptClass, add_script_classes, find_script_classes

AGENT = ScriptClass("Agent", "Node", "res://a/agent.gd", "res://a/agent.svg")
WIRE = ScriptClass("Wire", "Reference", "res://a/wire.gd", "")

WITHOUT = """\
; mine
config_version=4

[application]

config/name="Game"
"""
LISTED = """\
config_version=4

_global_script_classes=[ {
"base": "Node",
"class": "Mine",
"language": "GDScript",
"path": "res://mine.gd"
} ]
_global_script_class_icons={
"Mine": ""
}

[application]

config/name="Game"
"""


def test_scripts_are_found(tmp_path: Path) -> None:
    (tmp_path / "agent.gd").write_text(
        'tool\nclass_name Agent, "res://a/agent.svg"\nextends Node\n\nclass Inner:\n\tpass\n'
    )
    (tmp_path / "wire.gd").write_text("class_name Wire\nextends Reference\n")
    (tmp_path / "plugin.gd").write_text("tool\nextends EditorPlugin\n")
    assert find_script_classes(tmp_path, "res://a") == [AGENT, WIRE]


@pytest.mark.parametrize("before", [WITHOUT, LISTED], ids=["no list", "a list"])
def test_classes_are_added_once(before: str) -> None:
    after = add_script_classes(before, [AGENT, WIRE])
    parsed = parse_config(after)
    assert parsed.string("application/config/name") == "Game"
    assert parsed.integer("/config_version") == 4
    classes = parsed.entries["/_global_script_classes"].value
    names = ["Mine", "Agent", "Wire"] if before == LISTED else ["Agent", "Wire"]
    assert [row.split('"')[3] for row in classes.splitlines() if '"class"' in row] == names
    assert '"path": "res://a/agent.gd"' in classes
    assert '"Agent": "res://a/agent.svg"' in parsed.entries["/_global_script_class_icons"].value
    assert add_script_classes(after, [AGENT, WIRE]) == after


def test_a_class_of_the_user_keeps_its_name() -> None:
    mine = ScriptClass("Mine", "Node2D", "res://other.gd", "")
    assert add_script_classes(LISTED, [mine]) == LISTED


def test_the_project_file_lists_all_classes() -> None:
    root = runnable_bundled_root(EngineKind.GODOT3)
    text = (root / "project.godot").read_text()
    scripts = find_script_classes(root / "addons/ludus", "res://addons/ludus")
    assert add_script_classes(text, scripts) == text
    assert text.count('"class":') == len(scripts)
