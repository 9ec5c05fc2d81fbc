extends "res://examples/identity/identity_task.gd"
## Reward 0 at best for answering with the number in the observation, less the squared error.

var _goal: float = 0.0


## Scores a number from -1 to 1.
func apply_action(action: PackedFloat32Array) -> void:
	var error := action[0] - _goal
	_finish_step(-error * error)


## Returns the rewarded number.
func get_observation() -> PackedFloat32Array:
	return PackedFloat32Array([_goal])


func _draw_task() -> void:
	_goal = _world.rng.randf_range(-1.0, 1.0)
