extends "res://examples/tag/body.gd"
## Runs away in any direction: slower than the chaser, but it turns at once.

const Instinct := preload("res://examples/tag/instinct.gd")

var _is_steered: bool = false


## Runs in a direction: two numbers from -1 to 1.
func apply_action(action: PackedFloat32Array) -> void:
	_run(Vector2(action[0], action[1]).limit_length())


## Begins a round.
func reset() -> void:
	super()
	_is_steered = false


## Lets a person steer with the arrow keys; in a round without these keys the runner flees by
## itself.
func get_manual_action() -> PackedFloat32Array:
	var wish := Input.get_vector(&"ui_left", &"ui_right", &"ui_up", &"ui_down")
	_is_steered = _is_steered or wish != Vector2.ZERO
	if not _is_steered:
		wish = Instinct.farthest_from(self, other.position)
	return PackedFloat32Array([wish.x, wish.y])
