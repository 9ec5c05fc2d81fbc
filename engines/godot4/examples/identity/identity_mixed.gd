extends "res://examples/identity/identity_task.gd"
## A choice and two numbers at once, seen as numbers, an index and a picture; one choice is masked.
##
## Reward 1 at best: 1 for the right choice, less the mean absolute error of the numbers. A masked
## choice costs [constant MASKED_COST], so that a trainer that ignores the mask shows.

## Number of alternatives; the agent's action declares the same.
const NUM_CHOICES := 3
## Width and height of the picture, pixels; it has three channels.
const PICTURE_SIZE := 3
const PICTURE_CHANNELS := 3
const MASKED_COST := 10.0

var _goal: int = 0
var _masked: int = 1
var _aim := Vector2.ZERO


## Scores [code]{"choice": int, "aim": two floats}[/code].
func apply_action(action: Dictionary) -> void:
	var choice: int = action["choice"]
	var aim: PackedFloat32Array = action["aim"]
	var error := (absf(aim[0] - _aim.x) + absf(aim[1] - _aim.y)) / 2.0
	var reward := 1.0 if choice == _goal else 0.0
	_finish_step(reward - error - (MASKED_COST if choice == _masked else 0.0))


## Returns the numbers to answer with, and the right choice both as an index and as the bright row
## of a picture.
func get_observation() -> Dictionary:
	return {
		"aim": PackedFloat32Array([_aim.x, _aim.y]),
		"goal": PackedInt64Array([_goal]),
		"picture": _picture(),
	}


## Returns one byte for each choice, 0 for the masked one.
func get_action_mask() -> PackedByteArray:
	var mask := PackedByteArray()
	mask.resize(NUM_CHOICES)
	mask.fill(1)
	mask[_masked] = 0
	return mask


func _picture() -> PackedByteArray:
	var row_bytes := PICTURE_SIZE * PICTURE_CHANNELS
	var pixels := PackedByteArray()
	pixels.resize(PICTURE_SIZE * row_bytes)
	for i: int in row_bytes:
		pixels[_goal * row_bytes + i] = 255
	return pixels


func _draw_task() -> void:
	_goal = _world.rng.randi_range(0, NUM_CHOICES - 1)
	_masked = (_goal + _world.rng.randi_range(1, NUM_CHOICES - 1)) % NUM_CHOICES
	_aim = Vector2(_world.rng.randf_range(-1.0, 1.0), _world.rng.randf_range(-1.0, 1.0))
