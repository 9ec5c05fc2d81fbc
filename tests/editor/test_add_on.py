"""The add-on in the editor: what a real editor process shows, hides and writes."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from ludus.addon import ADDON_PATH
from ludus.engine import (
    EngineKind,
    EngineProcess,
    LaunchConfig,
    ensure_imported,
    find_engine,
    read_project,
)
from tests.editor_probe import PROBE, PROBE_PLUGIN
from tests.godot_project import AGENT_SCENE, write_project

pytestmark = [pytest.mark.engine, pytest.mark.editor]

TIMEOUT_S = 120.0
Seen = tuple[Path, dict[str, Any]]
GAME = """\
extends Node2D
func apply_action(_action: int) -> void:
	pass
func get_observation() -> PackedFloat32Array:
	return [0.0]
func get_reward() -> float:
	return 0.0
func is_done() -> bool:
	return false
func reset() -> void:
	pass
"""
LOOK = """\
@tool
extends RefCounted
var result := {}
var plugin: EditorPlugin
var tree: SceneTree = Engine.get_main_loop()
"""
LOOK_AT_ALL = """\
func look() -> void:
	for what: String in {names}:
		var part: RefCounted = load("res://look at %s.gd" % what).new()
		part.plugin = plugin
		await part.look()
		result[what] = part.result
"""
PLUGINS = """\
[editor_plugins]

enabled=PackedStringArray("res://addons/probe/plugin.cfg")
"""


@pytest.fixture(scope="module")
def imported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project with the add-on, and a plugin that runs ``look.gd`` in the editor."""
    folder = tmp_path_factory.mktemp("editor") / "game"
    probe = folder / "addons" / "probe"
    probe.mkdir(parents=True)
    (probe / "plugin.cfg").write_text(PROBE_PLUGIN)
    (probe / "probe.gd").write_text(PROBE)
    scene = AGENT_SCENE["godot4"].format(script="game", root="Node2D")
    files = {"game.gd": GAME, "game.tscn": scene}
    write_project(folder, files, main="game", more=PLUGINS)
    ensure_imported(find_engine(EngineKind.GODOT4), read_project(folder))
    return folder


@pytest.fixture(scope="module")
def seen(imported: Path, tmp_path_factory: pytest.TempPathFactory) -> Seen:
    """A project as an editor left it, and by test what its script saw there; one editor for all."""
    project = shutil.copytree(imported, tmp_path_factory.mktemp("seen") / "game")
    (project / "former.tscn").write_text(FORMER_SCENE)
    # The last one turns the plugin off and on.
    scripts = {
        "warnings": WARNINGS, "shown": SHOWN, "add node": ADD_NODE, "keys": KEYS,
        "former names": FORMER_NAMES, "autoload": AUTOLOAD,
    }  # fmt: skip
    return project, look(project, scripts)


def look(project: Path, scripts: Mapping[str, str]) -> dict[str, Any]:
    """Open a project in the editor, and return what each script puts into ``result`` there."""
    for name, script in scripts.items():
        (project / f"look at {name}.gd").write_text(LOOK + script)
    (project / "look.gd").write_text(LOOK + LOOK_AT_ALL.format(names=json.dumps([*scripts])))
    godot = str(find_engine(EngineKind.GODOT4).executable(headless=True))
    command = (godot, "--headless", "--editor", "--path", str(project))
    with EngineProcess.start(LaunchConfig(command=command)) as process:
        assert process.wait(TIMEOUT_S) == 0, process.describe_death()
        lines = process.last_lines()
    results = [line for line in lines if line.startswith("PROBE ")]
    assert results, "\n".join(lines)
    assert not [line for line in lines if "SCRIPT ERROR" in line], "\n".join(lines)
    return json.loads(results[0].removeprefix("PROBE "))


WARNINGS = """\
func look() -> void:
	EditorInterface.open_scene_from_path("res://game.tscn")
	await tree.process_frame
	var root := EditorInterface.get_edited_scene_root()
	var agent: LudusAgent = root.get_node("LudusAgent")
	var world := LudusWorld.new()
	root.add_child(world)
	world.owner = root
	var seen: Array[Node] = []
	tree.node_configuration_warning_changed.connect(seen.append)
	var component := agent.action[0]
	var changes: Dictionary[String, Callable] = {
		"policy_name": func() -> void: agent.policy_name = "",
		"target_path": func() -> void: agent.target_path = ^"nowhere",
		"action": func() -> void: agent.action = [],
		"the action back": func() -> void: agent.action = [component],
		"kind of the component": func() -> void: component.kind = 1,
		"low of the component": func() -> void: component.low = 5.0,
		"name of the component": func() -> void: component.name = "steer",
		"observation": func() -> void: agent.observation = [null],
		"has_action_mask": func() -> void: agent.has_action_mask = true,
		"policy": func() -> void: agent.policy = LudusPolicy.new(),
		"model of the policy": func() -> void: agent.policy.model = null,
		"settle_ticks of the world": func() -> void: world.settle_ticks = 3,
		"layout of the world": func() -> void: world.layout = LudusWorld.Layout.GRID,
	}
	for what: String in changes:
		seen.clear()
		changes[what].call()
		await tree.process_frame
		result[what] = seen.has(world if "world" in what else agent)
	result["warnings"] = agent._get_configuration_warnings() + world._get_configuration_warnings()
"""


def test_warnings_follow_every_change_of_a_property(seen: Seen) -> None:
    _, results = seen
    result = results["warnings"]
    warnings = "\n".join(result.pop("warnings"))
    assert [what for what, has_followed in result.items() if not has_followed] == []
    for part in ("policy_name is empty", "target_path", "low must be below high", "settle_ticks"):
        assert part in warnings


SHOWN = """\
func shown(object: Object) -> Array:
	var names := []
	for property: Dictionary in object.get_property_list():
		var usage: int = property["usage"]
		if usage & PROPERTY_USAGE_SCRIPT_VARIABLE and usage & PROPERTY_USAGE_EDITOR:
			names.append(property["name"])
	return names
func look() -> void:
	result["discrete"] = shown(LudusActionComponent.discrete("jump", 3))
	result["continuous"] = shown(LudusActionComponent.continuous("steer"))
	var component := LudusActionComponent.continuous("steer", 2, -3.0, 4.0)
	component.kind = LudusActionComponent.Kind.DISCRETE
	ResourceSaver.save(component, "res://component.tres")
	for property: Dictionary in LudusTraining.new().get_property_list():
		if str(property["name"]).ends_with("_folder"):
			result[property["name"]] = property["hint"]
"""
PROPERTY_HINT_DIR = 14


def test_the_inspector_shows_what_a_component_uses(seen: Seen) -> None:
    project, results = seen
    result = results["shown"]
    assert result["discrete"] == ["name", "kind", "n"]
    assert result["continuous"] == ["name", "kind", "size", "low", "high"]
    assert "low = -3.0" in (project / "component.tres").read_text(), "what is hidden is kept"
    assert result["runs_folder"] == result["policies_folder"] == PROPERTY_HINT_DIR, (
        "a dialog that writes res:// paths, not those of one machine"
    )


AUTOLOAD = """\
func look() -> void:
	result["at the start"] = ProjectSettings.has_setting("autoload/Ludus")
	EditorInterface.set_plugin_enabled("ludus", false)
	result["disabled"] = ProjectSettings.has_setting("autoload/Ludus")
	EditorInterface.set_plugin_enabled("ludus", true)
	result["enabled"] = ProjectSettings.has_setting("autoload/Ludus")
"""


def test_the_plugin_adds_and_removes_the_autoload(seen: Seen) -> None:
    _, results = seen
    assert results["autoload"] == {"at the start": True, "disabled": False, "enabled": True}


def test_a_deleted_autoload_stays_deleted(imported: Path, tmp_path: Path) -> None:
    project = shutil.copytree(imported, tmp_path / "game")
    settings = project / "project.godot"
    before = settings.read_text()
    settings.write_text(re.sub(r"^Ludus=.*\n", "", before, flags=re.MULTILINE))
    assert settings.read_text() != before
    assert look(project, {"autoload": AUTOLOAD})["autoload"]["at the start"] is False


def test_icons_follow_scale_and_theme_of_the_editor(imported: Path) -> None:
    icons = sorted((imported / ADDON_PATH / "icons").glob("*.svg.import"))
    assert icons
    plain = [icon.name for icon in icons if '"has_editor_variant": true' not in icon.read_text()]
    assert plain == []


ADD_NODE = """\
func look() -> void:
	for entry: Dictionary in ProjectSettings.get_global_class_list():
		var path: String = entry["path"]
		var script: Script = load(path)
		if path.begins_with("res://addons/ludus/"):
			var base := script.get_instance_base_type()
			result[entry["class"]] = base == &"Node" or ClassDB.is_parent_class(base, &"Node")
"""
PLACED = {
    "LudusAgent",
    "LudusCamera2D",
    "LudusCamera3D",
    "LudusController2D",
    "LudusController3D",
    "LudusDebugView",
    "LudusPolicyPlayer",
    "LudusSimulationHost",
    "LudusTraining",
    "LudusWorld",
}
SENSORS = {
    f"Ludus{name}{dimensions}"
    for name in ("Grid", "Nearest", "Rays", "Relative", "Sensor")
    for dimensions in ("2D", "3D")
}


def test_add_node_offers_only_what_a_person_places(seen: Seen) -> None:
    _, results = seen
    classes = results["add node"]
    assert {name for name, is_node in classes.items() if is_node} == PLACED | SENSORS
    assert "LudusBridge" in classes, "a name for scripts, which is no node"


KEYS = """\
func look() -> void:
	var training: Script = load("res://addons/ludus/training/ludus_training.gd")
	result["keys"] = training.get_property_default_value(&"keys").keys()
"""


def test_the_inspector_lists_the_keys_that_guide_training(seen: Seen) -> None:
    _, results = seen
    keys = results["keys"]["keys"]
    assert len(keys) == 10
    assert "ludus_start" in keys


FORMER_NAMES = """\
func look() -> void:
	EditorInterface.open_scene_from_path("res://former.tscn")
	await tree.process_frame
	EditorInterface.save_scene()
"""
FORMER_SCENE = """\
[gd_scene format=3]
[ext_resource type="Script" path="res://addons/ludus/training/ludus_training.gd" id="1"]
[ext_resource type="Script" path="res://addons/ludus/agent/ludus_agent.gd" id="2"]
[node name="Former" type="Node"]
[node name="Training" type="Node" parent="."]
script = ExtResource("1")
num_drawn = 7
starts_by_itself = false
has_keys = false
[node name="Agent" type="Node" parent="."]
script = ExtResource("2")
is_sampling = true
"""


def test_a_scene_with_former_names_is_saved_with_the_new_ones(seen: Seen) -> None:
    project, _ = seen
    saved = (project / "former.tscn").read_text()
    for line in ("visible_worlds = 7", "autostart = false", "shortcuts_enabled = false"):
        assert line in saved
    assert "sample_actions = true" in saved
    assert not re.search("num_drawn|starts_by_itself|has_keys|is_sampling|process_mode", saved)
