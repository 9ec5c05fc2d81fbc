"""Small Godot projects that tests write."""

from __future__ import annotations

import shlex
import subprocess
from collections.abc import Mapping
from pathlib import Path

from ludus.addon import install_addon
from ludus.engine import EngineKind, export_game, find_engine

__all__ = ["AGENT_SCENE", "export_project", "write_project"]

# A game that fails is not to fill the user's folder with its logs.
_SETTINGS = {
    "godot4": """\
config_version=5

[application]

config/name="Test"
config/features=PackedStringArray("4.4")
run/main_scene="res://{main}.tscn"

[debug]

file_logging/enable_file_logging=false
file_logging/enable_file_logging.pc=false

{more}""",
    "godot3": """\
config_version=4

[application]

config/name="Test"
run/main_scene="res://{main}.tscn"

[logging]

file_logging/enable_file_logging=false

{more}""",
}

AGENT_SCENE = {
    "godot4": """\
[gd_scene format=3]
[ext_resource path="res://{script}.gd" type="Script" id="1"]
[ext_resource path="res://addons/ludus/agent/ludus_agent.gd" type="Script" id="2"]
[ext_resource path="res://addons/ludus/agent/ludus_action_component.gd" type="Script" id="3"]
[sub_resource type="Resource" id="1"]
script = ExtResource("3")
[node name="Game" type="{root}"]
script = ExtResource("1")
[node name="LudusAgent" type="Node" parent="."]
script = ExtResource("2")
action = Array[ExtResource("3")]([SubResource("1")])
""",
    "godot3": """\
[gd_scene format=2]
[ext_resource path="res://{script}.gd" type="Script" id=1]
[ext_resource path="res://addons/ludus/ludus_agent.gd" type="Script" id=2]
[ext_resource path="res://addons/ludus/ludus_action_component.gd" type="Script" id=3]
[sub_resource type="Resource" id=1]
script = ExtResource( 3 )
[node name="Game" type="{root}"]
script = ExtResource( 1 )
[node name="LudusAgent" type="Node" parent="."]
script = ExtResource( 2 )
action = [ SubResource( 1 ) ]
""",
}
"""By engine: a root node of type ``root`` with a script, and an agent with two choices."""


_GODOT3_PRESETS = """\
[preset.0]
name="Linux"
platform="Linux/X11"
export_filter="all_resources"
include_filter="{include}"
exclude_filter=""
[preset.0.options]
"""
_EXPORT_TIMEOUT_S = 120.0


def export_project(
    kind: str, project: Path, output: Path, include: tuple[str, ...] = ("*.json",)
) -> Path:
    """Export a project as a game for this machine, and return its executable.

    For Godot 3, whose templates Ludus does not install, that is the exported data beside a program
    that plays them with the engine.

    Args:
        kind: ``godot4`` or ``godot3``.
        project: Folder of the project.
        output: Executable to write.
        include: Patterns of further files, which are not resources.
    """
    if kind == "godot4":
        return export_game(project, output, include=include)
    presets = _GODOT3_PRESETS.format(include=", ".join(include))
    (project / "export_presets.cfg").write_text(presets)
    engine = str(find_engine(EngineKind.GODOT3).executable(headless=True))
    output.parent.mkdir(parents=True, exist_ok=True)
    pack = output.with_suffix(".pck")
    subprocess.run(
        [engine, "--path", str(project), "--export-pack", "Linux", str(pack)],
        check=True,
        capture_output=True,
        timeout=_EXPORT_TIMEOUT_S,
    )
    output.write_text(f'#!/bin/sh\nexec {shlex.join([engine, "--main-pack", str(pack)])} "$@"\n')
    output.chmod(0o755)
    return output


def write_project(
    folder: Path, files: Mapping[str, str], *, main: str, kind: str = "godot4", more: str = ""
) -> Path:
    """Write a project with the add-on into a folder, which is made.

    Args:
        folder: Folder of the project.
        files: Contents of the other files by name.
        main: Main scene, without its ending.
        kind: ``godot4`` or ``godot3``.
        more: Further sections of ``project.godot``.

    Returns:
        The folder.
    """
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "project.godot").write_text(_SETTINGS[kind].format(main=main, more=more))
    for name, text in files.items():
        (folder / name).write_text(text)
    install_addon(folder)
    return folder
