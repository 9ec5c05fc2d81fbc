"""A project for either Godot whose agents see a coloured box through cameras, in 3D and in 2D."""

from __future__ import annotations

from pathlib import Path

from ludus.addon import install_addon

PROJECTS = {
    "godot3": """\
config_version=4

[application]

config/name="Cameras"
run/main_scene="res://box_3d.tscn"

[logging]

file_logging/enable_file_logging=false

[rendering]

environment/default_clear_color=Color( 0, 0, 0, 1 )
""",
    "godot4": """\
config_version=5

[application]

config/name="Cameras"
config/features=PackedStringArray("4.4")
run/main_scene="res://box_3d.tscn"

[debug]

file_logging/enable_file_logging=false
file_logging/enable_file_logging.pc=false

[rendering]

environment/defaults/default_clear_color=Color(0, 0, 0, 1)
""",
}

# The box begins at the left and goes to the right for action 1, where the episode ends. What an
# added node shows is as blue as nothing else.
BOX_3D = """\
extends Spatial
const COLOURS := [Color(1, 0, 0), Color(0, 1, 0), Color(1, 1, 0)]
var num_frames := 0
func _ready() -> void:
	var _error: int = VisualServer.connect("frame_post_draw", self, "count_frame")
	paint($Box, COLOURS[LudusWorld.of(self).index % 3])
func paint(box: MeshInstance, colour: Color) -> void:
	var material := SpatialMaterial.new()
	material.flags_unshaded = true
	material.albedo_color = colour
	box.material_override = material
func count_frame() -> void:
	num_frames += 1
func ludus_get_num_frames() -> int:
	return num_frames
func ludus_add_box() -> void:
	var box := MeshInstance.new()
	box.mesh = $Box.mesh
	paint(box, Color(0, 0, 1))
	add_child(box)
	box.translation = Vector3(1, -0.6, -3)
func ludus_move_box(x: float) -> void:
	$Box.translation.x = x
func ludus_refresh() -> void:
	$Eye.refresh()
func ludus_see() -> Array:
	return Array($Eye.get_pixels())
func apply_action(action: int) -> void:
	$Box.translation.x = 1.0 if action == 1 else -1.0
func get_observation() -> Dictionary:
	return {"eye": $Eye.get_image(), "grey": $Grey.get_image()}
func get_reward() -> float:
	return 0.0
func is_done() -> bool:
	return $Box.translation.x > 0.0
func reset() -> void:
	var start: float = LudusWorld.of(self).parameters.get("start", -1.0)
	$Box.translation = Vector3(start, 0.6, -3)
"""
# Draws the box itself, which engines do only at the end of a tick.
BOX_2D = """\
extends Node2D
const COLOURS := [Color(1, 0, 0), Color(0, 1, 0), Color(1, 1, 0)]
var box := Vector2(-30, -25)
func _draw() -> void:
	draw_rect(Rect2(box, Vector2(20, 20)), COLOURS[LudusWorld.of(self).index % 3])
func apply_action(action: int) -> void:
	box.x = 10.0 if action == 1 else -30.0
	update()
func get_observation() -> Dictionary:
	return {"eye": $Eye.get_image(), "grey": $Grey.get_image()}
func get_reward() -> float:
	return 0.0
func is_done() -> bool:
	return box.x > 0.0
func reset() -> void:
	var start: float = LudusWorld.of(self).parameters.get("start", -1.0)
	box = Vector2(20.0 * start - 10.0, -25)
	update()
"""

HEAD = """\
[gd_scene format=2]
[ext_resource path="res://box_{kind}.gd" type="Script" id=1]
[ext_resource path="res://addons/ludus/ludus_agent.gd" type="Script" id=2]
[ext_resource path="res://addons/ludus/ludus_action_component.gd" type="Script" id=3]
[ext_resource path="res://addons/ludus/ludus_world.gd" type="Script" id=4]
[ext_resource path="res://addons/ludus/ludus_camera_{kind}.gd" type="Script" id=5]
[sub_resource type="Resource" id=1]
script = ExtResource( 3 )
[sub_resource type="CubeMesh" id=2]
size = Vector3( 1, 1, 1 )
"""
NODES_3D = """\
[node name="Root" type="Spatial"]
script = ExtResource( 1 )
[node name="Box" type="MeshInstance" parent="."]
mesh = SubResource( 2 )
[node name="Eye" type="Camera" parent="."]
script = ExtResource( 5 )
width = {width}
height = {height}
[node name="Grey" type="Camera" parent="."]
script = ExtResource( 5 )
width = 16
height = 16
channels = 1
"""
NODES_2D = """\
[node name="Root" type="Node2D"]
script = ExtResource( 1 )
[node name="Eye" type="Node2D" parent="."]
script = ExtResource( 5 )
width = {width}
height = {height}
seen_size = Vector2( 80, 60 )
[node name="Grey" type="Node2D" parent="."]
script = ExtResource( 5 )
width = 16
height = 16
channels = 1
seen_size = Vector2( 80, 80 )
"""
# In the grid the neighbours are so near that they would be seen.
TAIL = """\
[node name="LudusAgent" type="Node" parent="."]
script = ExtResource( 2 )
ticks_per_step = 2
action = [ SubResource( 1 ) ]
[node name="LudusWorld" type="Node" parent="."]
script = ExtResource( 4 )
spacing = Vector3( {spacing} )
"""

WIDTH, HEIGHT = 32, 24
SCENES = {
    "box_3d": HEAD.format(kind="3d")
    + NODES_3D.format(width=WIDTH, height=HEIGHT)
    + TAIL.format(spacing="1.5, 0, 0"),
    "box_2d": HEAD.format(kind="2d")
    + NODES_2D.format(width=WIDTH, height=HEIGHT)
    + TAIL.format(spacing="200, 200, 0"),
}

_GODOT4_SCRIPT = {
    "Spatial\n": "Node3D\n",
    'VisualServer.connect("frame_post_draw", self, "count_frame")': (
        "RenderingServer.frame_post_draw.connect(count_frame)"
    ),
    "SpatialMaterial": "StandardMaterial3D",
    "flags_unshaded = true": "shading_mode = BaseMaterial3D.SHADING_MODE_UNSHADED",
    "MeshInstance": "MeshInstance3D",
    "translation": "position",
    "\tupdate()": "\tqueue_redraw()",
}
_GODOT4_SCENE = {
    "format=2": "format=3",
    '"Spatial"': '"Node3D"',
    '"MeshInstance"': '"MeshInstance3D"',
    '"Camera"': '"Camera3D"',
    "CubeMesh": "BoxMesh",
    "action = [ SubResource( 1 ) ]": 'action = Array[ExtResource("3")]([SubResource("1")])',
    **{f"id={i}": f'id="{i}"' for i in range(1, 6)},
    **{f"Resource( {i} )": f'Resource("{i}")' for i in range(1, 6)},
}


def _translated(text: str, words: dict[str, str], engine: str) -> str:
    for godot3, godot4 in words.items() if engine == "godot4" else ():
        text = text.replace(godot3, godot4)
    return text


def make_project(folder: Path, engine: str) -> Path:
    """Write the project for ``godot3`` or ``godot4``."""
    (folder / "project.godot").write_text(PROJECTS[engine])
    for name, text in {"box_3d": BOX_3D, "box_2d": BOX_2D}.items():
        (folder / f"{name}.gd").write_text(_translated(text, _GODOT4_SCRIPT, engine))
    for name, text in SCENES.items():
        (folder / f"{name}.tscn").write_text(_translated(text, _GODOT4_SCENE, engine))
    # Godot 4 has the scripts in folders of the add-on; installing it rewrites the scenes.
    install_addon(folder)
    return folder.resolve()
