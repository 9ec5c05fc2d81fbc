extends "res://walker.gd"
## Sees a picture that a camera's viewport draws: the redder, the further it is.

const TICKS := 4.0

var _viewport := SubViewport.new()
var _wall := ColorRect.new()


func _init() -> void:
	policy_name = "seer"
	_viewport.size = Vector2i(4, 3)
	_viewport.render_target_update_mode = SubViewport.UPDATE_WHEN_PARENT_VISIBLE
	_wall.size = Vector2(4, 3)
	_viewport.add_child(_wall)
	add_child(_viewport)


func _physics_process(delta: float) -> void:
	super(delta)
	_wall.modulate = Color8(roundi(_place * 40.0), 80, 160)


func get_obs_space() -> Dictionary:
	return {"camera_2d": {"size": [3, 3, 4], "space": "box"}}


func get_obs() -> Dictionary:
	return {"camera_2d": _viewport.get_texture().get_image().get_data().hex_encode()}


func get_action_space() -> Dictionary:
	return {"move": {"size": 1, "action_type": "continuous"}}


func set_action(action: Dictionary) -> void:
	_speed = action["move"][0] / TICKS
