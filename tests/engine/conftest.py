"""Fixtures for the engine layer: a real Godot, pretended ones, and small projects."""

from __future__ import annotations

from pathlib import Path

import pytest

from ludus.engine.kinds import EngineKind

PROJECT_TEXT = """\
; Engine configuration file.
config_version=5

[application]

config/name="Tiny"
run/main_scene="res://main.tscn"
"""
SCENE_TEXT = """\
[gd_scene load_steps=2 format=3 uid="uid://dtinyscene"]

[ext_resource type="Script" path="res://main.gd" id="1"]

[node name="Main" type="Node"]
script = ExtResource("1")
"""
SCRIPT_TEXT = """\
extends Node

func _ready() -> void:
\tprint("args ", OS.get_cmdline_user_args())
\tprint("tiny ", TinyThing.new().value)
"""
THING_TEXT = "class_name TinyThing\nextends RefCounted\nvar value := 7\n"


@pytest.fixture
def bare_machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A machine without any engine; returns the folder that is its PATH."""
    folder = tmp_path / "bin"
    folder.mkdir()
    monkeypatch.setenv("PATH", str(folder))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    for kind in EngineKind:
        monkeypatch.delenv(kind.traits.environment_variable, raising=False)
    return folder


@pytest.fixture
def tiny_project(tmp_path: Path) -> Path:
    """A Godot 4 project whose main scene needs an import, because it uses a class name."""
    root = tmp_path / "tiny"
    root.mkdir()
    (root / "project.godot").write_text(PROJECT_TEXT)
    (root / "main.tscn").write_text(SCENE_TEXT)
    (root / "main.gd").write_text(SCRIPT_TEXT)
    (root / "thing.gd").write_text(THING_TEXT)
    return root
