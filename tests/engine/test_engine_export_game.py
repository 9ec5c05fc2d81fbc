"""Exporting a project with the real engine: what comes out, what stays, and what is an error."""

from __future__ import annotations

from pathlib import Path

import pytest

from ludus.engine.export_game import export_game
from ludus.engine.find import InstalledEngine
from ludus.engine.launch import LaunchConfig
from ludus.engine.process import EngineProcess
from ludus.engine.template import ExportTemplate
from ludus.errors import EngineStartError, EngineTimeout, SetupError, TargetError

pytestmark = [pytest.mark.engine, pytest.mark.games, pytest.mark.timeout(600)]

PROJECT = """\
config_version=5

[application]

config/name="Small"
run/main_scene="res://main.tscn"
"""
SCENE = """\
[gd_scene load_steps=2 format=3]

[ext_resource type="Script" path="res://main.gd" id="1"]

[node name="Main" type="Node"]
script = ExtResource("1")
"""
SCRIPT = """\
extends Node

func _ready() -> void:
	for path: String in ["res://data/loose.json", "res://data/loose.txt"]:
		print(path, " ", FileAccess.get_file_as_string(path))
	get_tree().quit(7)
"""
PRESETS = '[preset.0]\n\nname="Mine"\nplatform="Windows Desktop"\n'


@pytest.fixture
def small_project(tmp_path: Path) -> Path:
    """A project with a preset of its own, loose files, and a link that leads back to it."""
    root = tmp_path / 'my "small" game'
    (root / "data").mkdir(parents=True)
    files = {"project.godot": PROJECT, "main.tscn": SCENE, "main.gd": SCRIPT}
    files |= {"export_presets.cfg": PRESETS, "data/loose.json": "[1]", "data/loose.txt": "[2]"}
    for name, text in files.items():
        (root / name).write_text(text)
    (root / "data" / "back").symlink_to(root)
    return root


def snapshot(root: Path) -> dict[str, tuple[int, bytes]]:
    """Return time and contents of every file and folder of a project."""
    return {
        str(path.relative_to(root)): (
            path.lstat().st_mtime_ns,
            path.read_bytes() if path.is_file() else b"",
        )
        for path in [root, *root.rglob("*")]
    }


def test_export_leaves_the_project_alone_and_takes_loose_files_along(
    template: ExportTemplate, small_project: Path, tmp_path: Path
) -> None:
    before = snapshot(small_project)
    output = tmp_path / "new folder" / "small.x86_64"
    assert export_game(small_project, output) == output
    assert snapshot(small_project) == before
    assert sorted(file.name for file in output.parent.iterdir()) == ["small.pck", "small.x86_64"]
    with EngineProcess.start(LaunchConfig(command=(str(output), "--headless"))) as process:
        assert process.wait(30) == 7
        lines = [line for line in process.last_lines() if line.startswith("res://")]
    assert lines == ["res://data/loose.json [1]", "res://data/loose.txt "]


def test_what_godot_leaves_out_fails_the_export(
    template: ExportTemplate, small_project: Path, tmp_path: Path
) -> None:
    (small_project / "main.gd").unlink()
    before = snapshot(small_project)
    with pytest.raises(EngineStartError) as caught:
        export_game(small_project, tmp_path / "new" / "small.x86_64")
    # Godot itself takes this for a success.
    assert "Godot could not export the project (exit code 0)" in caught.value.message
    assert "res://main.gd" in caught.value.message
    assert snapshot(small_project) == before
    assert not (tmp_path / "new").exists()


def test_export_that_takes_too_long_is_ended(
    template: ExportTemplate, small_project: Path, tmp_path: Path
) -> None:
    with pytest.raises(EngineTimeout, match=r"did not end within 0\.1 s"):
        export_game(small_project, tmp_path / "small.x86_64", timeout_s=0.1)
    assert not (tmp_path / "small.x86_64").exists()


def test_without_a_template_nothing_is_exported(
    godot4: InstalledEngine, small_project: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for variable in ("XDG_CACHE_HOME", "XDG_DATA_HOME"):
        monkeypatch.setenv(variable, str(tmp_path))
    with pytest.raises(SetupError, match="no export template"):
        export_game(small_project, tmp_path / "small.x86_64", godot=godot4.path)


def test_games_of_godot_3_are_refused(small_project: Path, tmp_path: Path) -> None:
    (small_project / "project.godot").write_text("config_version=4\n")
    with pytest.raises(TargetError, match="is a project for Godot 3"):
        export_game(small_project, tmp_path / "small.x86_64")
