extends "res://walker.gd"
## Sees a picture: two rows of three pixels with four channels, which it declares channels first.


func _init() -> void:
	policy_name = "watcher"


func get_obs_space() -> Dictionary:
	return {"camera_2d": {"size": [4, 2, 3], "space": "box"}}


func get_obs() -> Dictionary:
	var pixels := PackedByteArray(range(24))
	pixels[23] = int(clampf(_place, 0.0, 3.0) * 10.0)
	return {"camera_2d": pixels.hex_encode()}


func get_action_space() -> Dictionary:
	return {"hop": {"size": 2, "action_type": "discrete"}}


func set_action(action: Dictionary) -> void:
	_speed = int(action["hop"]) / 4.0
