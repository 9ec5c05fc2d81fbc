"""Scripts and scenes of ``godot_game.py`` and ``test_press_play.py`` in the dialect of Godot 3."""

from __future__ import annotations

__all__ = ["DRIVER", "LIFE", "MAIN", "PENNIES", "PROJECT", "SCENE", "TRAINING"]

PROJECT = """\
config_version=4
[application]
config/name="Guides"
run/main_scene="res://main.tscn"
[logging]
file_logging/enable_file_logging=false
"""

PENNIES = """\
extends LudusAgent
const FAULTS := {"is_broken": false}
export var sign_of_equal := 1.0
export var other: NodePath
var choice := 0
var steps := 0
func _init() -> void:
	observation = [LudusObservationEntry.create("seen", PoolIntArray([SIZE]))]
	action = [LudusActionComponent.discrete("say", 2)]
	settings = LudusPolicySettings.new()
	settings.hidden_sizes = PoolIntArray([8])
	settings.more = {"rollout_steps": 20, "epochs": 1}
	ticks_per_step = 1
func apply_action(given: int) -> void:
	choice = given
func get_observation() -> Array:
	var seen := []
	seen.resize(SIZE)
	seen.fill(steps / 10.0)
	return seen
func get_reward() -> float:
	steps += 1
	if FAULTS["is_broken"] and LudusWorld.of(self).index == 2:
		return NAN
	return sign_of_equal if choice == get_node(other).choice else -sign_of_equal
func is_done() -> bool:
	return steps >= 10
func reset() -> void:
	steps = 0
"""

SCENE = """\
[gd_scene format=2]
[ext_resource path="res://pennies.gd" type="Script" id=1]
[node name="Game" type="Node"]
[node name="Even" type="Node" parent="."]
script = ExtResource( 1 )
policy_name = "even"
other = NodePath("../Odd")
[node name="Odd" type="Node" parent="."]
script = ExtResource( 1 )
policy_name = "odd"
sign_of_equal = -1.0
other = NodePath("../Even")
"""

DRIVER = """\
extends Node
onready var training: LudusTraining = $"../Training"
var folder := ""
var heard := File.new()
func _ready() -> void:
	pause_mode = Node.PAUSE_MODE_PROCESS
	for argument in OS.get_cmdline_args():
		if argument.begins_with("--folder="):
			folder = argument.trim_prefix("--folder=")
		elif argument.begins_with("--port="):
			training.port = int(argument.trim_prefix("--port="))
	var _opened := heard.open(folder.plus_file("heard"), File.WRITE)
	var _first := training.connect("status_changed", self, "note")
	var _second := training.connect("state_changed", self, "_on_state_changed")
	training.connect_trainer()
func _on_state_changed(state: int) -> void:
	if state == LudusTraining.State.OFFLINE:
		note({"state": "offline", "message": training.message})
func note(status: Dictionary) -> void:
	heard.store_line(to_json(status))
	heard.flush()
func _process(_delta: float) -> void:
	var path := folder.plus_file("ask")
	var file := File.new()
	if file.open(path, File.READ) != OK:
		return
	var words := file.get_as_text().split(" ")
	file.close()
	var _removed := Directory.new().remove(path)
	match words[0]:
		"break":
			load("res://pennies.gd").FAULTS["is_broken"] = true
		"set_policy_mode":
			var _is_asked := training.set_policy_mode(words[1], LudusBridge.PolicyMode[words[2]])
		_:
			training.call(words[0])
"""

MAIN = """\
[gd_scene format=2]
[ext_resource path="res://addons/ludus/ludus_training.gd" type="Script" id=1]
[ext_resource path="res://driver.gd" type="Script" id=2]
[node name="Main" type="Node"]
[node name="Training" type="Node" parent="."]
script = ExtResource( 1 )
run_name = "pennies"
num_worlds = {num_worlds}
checkpoint_every_updates = 4
starts_by_itself = false
scene_path = "res://pennies.tscn"
[node name="Driver" type="Node" parent="."]
script = ExtResource( 2 )
"""

TRAINING = """\
[ext_resource path="res://addons/ludus/ludus_training.gd" type="Script" id=2]
[ext_resource path="res://life.gd" type="Script" id=3]
[node name="Training" type="Node" parent="."]
script = ExtResource( 2 )
run_name = "pressed"
num_worlds = 8
port = {port}
[node name="Life" type="Node" parent="."]
script = ExtResource( 3 )
"""

LIFE = """\
extends Node
func _ready() -> void:
	if not $"../Training".is_in_charge():
		queue_free()
func _process(_delta: float) -> void:
	if Engine.get_idle_frames() % 20 == 0:
		printerr("alive: ", $"../Training".message)
"""
