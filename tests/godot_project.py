"""Small Godot projects that tests write."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from ludus.addon import install_addon

__all__ = ["AGENT_SCENE", "write_project"]

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
