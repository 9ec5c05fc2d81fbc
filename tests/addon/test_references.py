"""Projects that name scripts of the add-on by the paths of older versions."""

from __future__ import annotations

from pathlib import Path

import pytest

from ludus.addon import ADDON_PATH, install_addon
from ludus.addon.references import moved_scripts, rewrite_references
from ludus.engine import EngineKind
from ludus.engine.bundled import bundled_root

MOVED = {"ludus_agent.gd": "agent/ludus_agent.gd", "ludus_wire.gd": "bridge/wire.gd"}
SCENE = b"""\
[gd_scene format=3]\r
[ext_resource type="Script" uid="uid://abc" path="res://addons/ludus/ludus_agent.gd" id="1"]\r
[ext_resource type="Script" path="res://addons/ludus/ludus_agent.gdshader" id="2"]\r
"""


@pytest.fixture
def project(tmp_path: Path) -> Path:
    (tmp_path / "project.godot").write_text(
        'config_version=5\n[autoload]\nLudus="*res://addons/ludus/ludus_bridge.gd"\n'
    )
    (tmp_path / "levels").mkdir()
    (tmp_path / "levels/hero.tscn").write_bytes(SCENE)
    (tmp_path / "levels/hero.tscn").chmod(0o640)
    return tmp_path


def test_moved_scripts_are_found_by_name() -> None:
    bundled = ["plugin.cfg", "agent/ludus_agent.gd", "agent/ludus_agent.gd.uid", "bridge/wire.gd"]
    assert moved_scripts(bundled) == MOVED
    assert moved_scripts(["ludus_agent.gd", "plugin.gd"]) == {}


def test_only_paths_of_moved_scripts_are_rewritten(project: Path) -> None:
    assert rewrite_references(project, ADDON_PATH, MOVED) == ("levels/hero.tscn",)
    rewritten = (project / "levels/hero.tscn").read_bytes()
    assert rewritten == SCENE.replace(b'/ludus_agent.gd"', b'/agent/ludus_agent.gd"')
    assert (project / "levels/hero.tscn").stat().st_mode & 0o777 == 0o640
    assert rewrite_references(project, ADDON_PATH, MOVED) == ()


def test_the_type_of_the_autoload_is_a_node(project: Path) -> None:
    script = """\
var bridge: LudusBridge = Ludus
func find() -> LudusBridge:
	return get_node("/root/Ludus") as LudusBridge
func freeze(mode: LudusBridge.PolicyMode = LudusBridge.PolicyMode.FROZEN) -> void:
	bridge.set_policy_mode("hero", mode)
"""
    (project / "menu.gd").write_text(script)
    assert install_addon(project).rewritten == ("menu.gd", "project.godot", "levels/hero.tscn")
    rewritten = script.replace("bridge: LudusBridge", "bridge: Node")
    rewritten = rewritten.replace("-> LudusBridge", "-> Node").replace("as LudusBridge", "as Node")
    assert (project / "menu.gd").read_text() == rewritten


def test_pictures_caches_links_and_the_add_on_are_left_alone(project: Path) -> None:
    left_alone = [".godot/a.tscn", "addons/ludus/a.tscn", "a.scn"]
    for name in left_alone:
        (project / name).parent.mkdir(parents=True, exist_ok=True)
        (project / name).write_bytes(SCENE)
    (project / "link.tscn").symlink_to(project / "a.scn")
    assert rewrite_references(project, ADDON_PATH, MOVED) == ("levels/hero.tscn",)
    assert all((project / name).read_bytes() == SCENE for name in left_alone)
    assert (project / "link.tscn").is_symlink()


def test_installation_rewrites_scenes_and_the_autoload(project: Path) -> None:
    change = install_addon(project)
    assert change.rewritten == ("project.godot", "levels/hero.tscn")
    text = (project / "project.godot").read_text()
    assert 'Ludus="*res://addons/ludus/bridge/ludus_bridge.gd"' in text
    assert text.count("ludus_bridge") == 1
    assert install_addon(project).rewritten == ()


def test_godot3_keeps_its_paths(project: Path) -> None:
    (project / "project.godot").write_text("config_version=4\n")
    assert install_addon(project).rewritten == ()
    assert (project / "levels/hero.tscn").read_bytes() == SCENE


def test_every_script_of_the_add_on_has_one_name() -> None:
    scripts = [
        path.relative_to(bundled_root(EngineKind.GODOT4) / ADDON_PATH).as_posix()
        for path in (bundled_root(EngineKind.GODOT4) / ADDON_PATH).rglob("*.gd")
    ]
    assert len(moved_scripts(scripts)) == len(scripts)
