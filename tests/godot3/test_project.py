"""Godot 3 projects are known by their project file: install, find, run."""

from __future__ import annotations

from pathlib import Path

import pytest

from ludus.addon import addon_status, install_addon
from ludus.engine import EngineKind, InstalledEngine
from ludus.engine.bundled import example_names, find_example
from ludus.engine.script_classes import ScriptClass, add_script_classes
from ludus.errors import ConfigError, TargetError
from ludus.legacy.addon import install_legacy_addon
from ludus.version import __version__
from tests.targets import find_scene


def test_the_add_on_is_installed_once(tmp_path: Path) -> None:
    (tmp_path / "project.godot").write_text("config_version=4\n")
    change = install_addon(tmp_path)
    assert "ludus_wire.gd" in change.added
    assert change.has_enabled_plugin
    text = (tmp_path / "project.godot").read_text()
    assert 'enabled=PoolStringArray("res://addons/ludus/plugin.cfg")' in text
    assert 'Ludus="*res://addons/ludus/ludus_bridge.gd"' in text
    assert '"class": "LudusAgent"' in text
    status = addon_status(tmp_path)
    assert status.is_enabled and status.is_current
    again = install_addon(tmp_path)
    assert not (again.added or again.updated or again.removed or again.has_enabled_plugin)
    assert (tmp_path / "project.godot").read_text() == text


DROPPED = {
    "game.gd": "extends LudusSimulation\n",
    "menu.gd": "func _pressed():\n\tLudus.start_training()\n",
    "find.gd": "func _pressed():\n\tget_node('/root/Ludus').write_policies()\n",
    "host.tscn": '[ext_resource path="res://addons/ludus/ludus_simulation_host.gd" id=1]\n',
}


@pytest.mark.parametrize("is_legacy", [False, True])
@pytest.mark.parametrize("name", DROPPED)
def test_a_game_that_needs_what_was_dropped_is_left_as_it_is(
    name: str, is_legacy: bool, tmp_path: Path
) -> None:
    (tmp_path / "project.godot").write_text("config_version=4\n")
    install_addon(tmp_path)
    (tmp_path / name).write_text(DROPPED[name])
    if is_legacy:
        (tmp_path / "legacy.gd").write_text("extends GymGodot\n")
    (tmp_path / "addons/ludus/ludus_agent.gd").unlink()
    before = {file: file.read_bytes() for file in tmp_path.rglob("*") if file.is_file()}
    install = install_legacy_addon if is_legacy else install_addon
    with pytest.raises(ConfigError, match=rf"(?s)no longer has.*{name}") as caught:
        install(tmp_path)
    assert f"keep the add-on of version {__version__}" in caught.value.hint
    assert {file: file.read_bytes() for file in tmp_path.rglob("*") if file.is_file()} == before


def test_classes_that_are_gone_are_no_longer_listed(tmp_path: Path) -> None:
    (tmp_path / "project.godot").write_text("config_version=4\n")
    install_addon(tmp_path)
    text = (tmp_path / "project.godot").read_text()
    gone = ScriptClass("LudusPace", "Node", "res://addons/ludus/ludus_pace.gd", "")
    mine = ScriptClass("Mine", "Node", "res://mine.gd", "res://mine.svg")
    listed = add_script_classes(text, [mine])
    for also in ([gone, mine], [mine, gone]):
        (tmp_path / "project.godot").write_text(add_script_classes(text, also))
        install_addon(tmp_path)
        assert (tmp_path / "project.godot").read_text() == listed


def test_each_engine_has_its_own_add_on(tmp_path: Path) -> None:
    for version, wire, base in (
        (4, "ludus_wire.gd", "extends Reference"),
        (5, "bridge/wire.gd", "extends RefCounted"),
    ):
        folder = tmp_path / str(version)
        folder.mkdir()
        (folder / "project.godot").write_text(f"config_version={version}\n")
        install_addon(folder)
        assert base in (folder / "addons/ludus" / wire).read_text()


def test_examples_say_their_engine() -> None:
    assert find_example("cartpole") == (EngineKind.GODOT4, "cartpole")
    assert find_example("godot4:cartpole") == (EngineKind.GODOT4, "cartpole")
    assert find_example("godot3:cartpole") == (EngineKind.GODOT3, "cartpole")
    for text in ("godot3:tag", "godot5:cartpole", ":cartpole", "godot3:", "localhost:80", "x"):
        assert find_example(text) is None, text
    assert {"cartpole", "godot3:cartpole", "godot3:pendulum"} <= set(example_names())


def test_an_example_for_godot3() -> None:
    scene = find_scene("godot3:cartpole")
    assert scene.project.engine_kind is EngineKind.GODOT3
    assert scene.path == "res://examples/cartpole/cartpole.tscn"
    with pytest.raises(TargetError, match="godot3:cartpole"):
        find_scene("godot3:cartpol")


@pytest.mark.engine
def test_a_project_needs_no_flag(project: Path, godot3: InstalledEngine) -> None:
    scene = find_scene(project)
    assert scene.project.engine_kind is EngineKind.GODOT3
    assert scene.find_engine() == godot3
    assert scene.path == "res://right.tscn"
