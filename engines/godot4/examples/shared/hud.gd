extends CanvasLayer
## Shows the name of an example, its keys, and how long the episodes last.

const GALLERY_PATH := "res://gallery/gallery.tscn"

## Name of the example.
@export var title: String
## What the keys do.
@export var controls: String
## The agent whose episodes are shown, from the root of the world.
@export var agent_path: NodePath = ^"LudusAgent"

var _agent: LudusAgent
var _last_length: int = 0
var _steps: int = 0

@onready var _title: Label = %Title
@onready var _controls: Label = %Controls
@onready var _episode: Label = %Episode


func _ready() -> void:
	_title.text = title
	var stage := owner if owner != null else get_parent()
	_agent = stage.get_parent().get_node_or_null(agent_path)
	_controls.text = controls + ("    Esc  back" if _is_played_alone() else "")


func _process(_delta: float) -> void:
	if _agent == null:
		return
	if _agent.episode_steps < _steps:
		_last_length = _steps
	_steps = _agent.episode_steps
	_episode.text = "step %d    last episode %d" % [_steps, _last_length]


func _unhandled_key_input(event: InputEvent) -> void:
	if event.is_action_pressed(&"ui_cancel") and _is_played_alone():
		get_tree().change_scene_to_file(GALLERY_PATH)


func _is_played_alone() -> bool:
	var scene := get_tree().current_scene
	return scene != null and scene.is_ancestor_of(self) and get_viewport() == get_tree().root
