"""The zips for the Asset Library: what is in them, and that they install into an empty project."""

from __future__ import annotations

import contextlib
import importlib.util
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from ludus.engine import (
    EngineKind,
    EngineProcess,
    LaunchConfig,
    ensure_imported,
    find_engine,
    read_project,
)
from ludus.session import LaunchOptions, open_session
from ludus.wire.handshake import EngineConfig
from tests.godot.conftest import reset, step
from tests.godot_project import AGENT_SCENE
from tests.targets import find_game

SCRIPT = Path(__file__).parents[2] / "engines" / "addon_zip.py"
EXTRAS = {"LICENSE", "README.md", "CHANGELOG.md", "icon.svg"}
GAME = """\
extends Node
func apply_action(_action): pass
func get_observation(): return [1.0]
func get_reward(): return 1.0
func is_done(): return false
func reset(): pass
"""
# A person who opens the project in the editor and ticks the box of the plugin.
ENABLE = {
    "godot4": """\
@tool
extends EditorPlugin
func _ready() -> void:
	await get_tree().create_timer(0.5).timeout
	EditorInterface.set_plugin_enabled("ludus", true)
	ProjectSettings.save()
	get_tree().quit()
""",
    "godot3": """\
tool
extends EditorPlugin
func _ready() -> void:
	yield(get_tree().create_timer(0.5), "timeout")
	get_editor_interface().set_plugin_enabled("ludus", true)
	var _error := ProjectSettings.save()
	get_tree().quit()
""",
}
PLUGIN = '[plugin]\nname="Person"\ndescription=""\nauthor=""\nversion="1"\nscript="person.gd"\n'
PROJECT = {
    "godot4": 'config_version=5\n[application]\nconfig/name="Empty"\n'
    'config/features=PackedStringArray("4.4")\nrun/main_scene="res://game.tscn"\n'
    '[editor_plugins]\nenabled=PackedStringArray("res://addons/person/plugin.cfg")\n',
    "godot3": 'config_version=4\n[application]\nconfig/name="Empty"\n'
    'run/main_scene="res://game.tscn"\n'
    '[editor_plugins]\nenabled=PoolStringArray( "res://addons/person/plugin.cfg" )\n',
}


@pytest.fixture(scope="module")
def pack() -> Callable[[str, Path], Path]:
    spec = importlib.util.spec_from_file_location("addon_zip", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.pack


@pytest.mark.parametrize("kind", ["godot4", "godot3"])
def test_a_zip_holds_the_add_on_alone(
    kind: str, pack: Callable[[str, Path], Path], tmp_path: Path
) -> None:
    packed = pack(kind, tmp_path)
    with zipfile.ZipFile(packed) as archive:
        names = archive.namelist()
    assert all(name.startswith("addons/ludus/") for name in names)
    inside = {name.removeprefix("addons/ludus/") for name in names}
    assert EXTRAS | {"plugin.cfg"} <= inside
    assert {Path(name).suffix for name in inside - EXTRAS} <= {
        ".cfg",
        ".gd",
        ".import",
        ".svg",
        ".tscn",
        ".uid",
    }
    assert pack(kind, tmp_path / "again").read_bytes() == packed.read_bytes()


@pytest.mark.engine
@pytest.mark.games
@pytest.mark.parametrize("kind", ["godot4", "godot3"])
def test_a_zip_installs_into_an_empty_project(
    kind: str, pack: Callable[[str, Path], Path], tmp_path: Path
) -> None:
    project = tmp_path / "project"
    person = project / "addons" / "person"
    person.mkdir(parents=True)
    (person / "plugin.cfg").write_text(PLUGIN)
    (person / "person.gd").write_text(ENABLE[kind])
    (project / "project.godot").write_text(PROJECT[kind])
    (project / "game.gd").write_text(GAME)
    (project / "game.tscn").write_text(AGENT_SCENE[kind].format(script="game", root="Node"))
    with zipfile.ZipFile(pack(kind, tmp_path)) as archive:
        archive.extractall(project)
    engine = find_engine(EngineKind(kind))
    godot = str(engine.executable(headless=True))
    headless = ("--headless",) if kind == "godot4" else ()
    command = (godot, *headless, "--editor", "--path", str(project))
    with EngineProcess.start(LaunchConfig(command=command)) as editor:
        assert editor.wait(120.0) == 0, editor.describe_death()
    assert "Ludus=" in (project / "project.godot").read_text(), "the plugin's autoload"
    ensure_imported(engine, read_project(project))
    session = open_session(find_game(project), EngineConfig(), LaunchOptions())
    with contextlib.closing(session):
        reset(session)
        assert step(session)["agent"].reward[0] == 1.0
