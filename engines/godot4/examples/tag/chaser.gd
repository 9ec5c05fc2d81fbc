extends "res://examples/tag/body.gd"
## Hunts the runner with nine choices: stand, or push in one of eight directions.
##
## Faster than the runner, but slow to turn.

const Instinct := preload("res://examples/tag/instinct.gd")
const NUM_DIRECTIONS := 8

var _is_steered: bool = false


## Stands (0) or pushes in one of eight directions, clockwise from +x (1 … 8).
func apply_action(action: int) -> void:
	_run(direction(action))


## Begins a round.
func reset() -> void:
	super()
	_is_steered = false


## Lets a person steer with W, A, S and D; in a round without these keys the chaser hunts by itself.
func get_manual_action() -> int:
	var wish := Vector2(
		_axis(KEY_A, KEY_D),
		_axis(KEY_W, KEY_S),
	)
	_is_steered = _is_steered or wish != Vector2.ZERO
	if not _is_steered:
		wish = Instinct.nearest_to(self, other.position + other.velocity * Instinct.FORESIGHT_S)
	return nearest_action(wish)


## Returns the unit vector of an action; nothing for 0.
static func direction(action: int) -> Vector2:
	if action == 0:
		return Vector2.ZERO
	return Vector2.from_angle(TAU * (action - 1) / NUM_DIRECTIONS)


## Returns the action whose direction is nearest to a wish.
static func nearest_action(wish: Vector2) -> int:
	if wish == Vector2.ZERO:
		return 0
	return 1 + posmod(roundi(wish.angle() * NUM_DIRECTIONS / TAU), NUM_DIRECTIONS)


static func _axis(negative: Key, positive: Key) -> float:
	return (
		float(Input.is_physical_key_pressed(positive))
		- float(Input.is_physical_key_pressed(negative))
	)
