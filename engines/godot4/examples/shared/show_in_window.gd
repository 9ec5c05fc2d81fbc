extends Node
## Loads what draws the scene above it if this world is the one on show. Put it into a scene whose
## root has no script of its own; see [code]in_window.gd[/code].

const InWindow := preload("res://examples/shared/in_window.gd")

## Steps per second while somebody watches, for games whose step is one tick; 0 leaves it alone.
@export var steps_per_second: int = 0

var _usual_ticks: int = 0


func _ready() -> void:
	if DisplayServer.get_name() != "headless":
		# The parent is still busy with its children.
		_show.call_deferred()


func _exit_tree() -> void:
	if _usual_ticks > 0:
		Engine.physics_ticks_per_second = _usual_ticks


## Undrawn worlds carry no drawing. One camera in a viewport means that one world is on show.
func _show() -> void:
	var viewport := get_viewport()
	var picture := viewport as SubViewport
	if picture != null and picture.render_target_update_mode == SubViewport.UPDATE_DISABLED:
		return
	if viewport.get_camera_2d() != null or viewport.get_camera_3d() != null:
		return
	if steps_per_second > 0:
		_usual_ticks = Engine.physics_ticks_per_second
		Engine.physics_ticks_per_second = steps_per_second
	InWindow.show(get_parent())
