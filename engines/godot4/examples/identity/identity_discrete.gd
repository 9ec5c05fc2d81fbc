extends "res://examples/identity/identity_task.gd"
## Reward 1 for choosing the alternative whose number in the observation is 1.

## Number of alternatives; the agent's action declares the same.
const NUM_CHOICES := 4

var _goal: int = 0


## Scores a choice.
func apply_action(action: int) -> void:
	_finish_step(1.0 if action == _goal else 0.0)


## Returns the rewarded choice as one-hot numbers.
func get_observation() -> PackedFloat32Array:
	var shown := PackedFloat32Array()
	shown.resize(NUM_CHOICES)
	shown[_goal] = 1.0
	return shown


func _draw_task() -> void:
	_goal = _world.rng.randi_range(0, NUM_CHOICES - 1)
