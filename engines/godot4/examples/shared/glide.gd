extends RefCounted
## Where to draw a body between two steps: on the way from the last place to the present one.

## A body that moved farther in one step was put there, pixels.
const JUMP := 60.0

var _from := Vector2.ZERO
var _to := Vector2.ZERO


## Notes the place after a step.
func step_to(place: Vector2) -> void:
	_from = _to if _to.distance_to(place) < JUMP else place
	_to = place


## The place to draw.
func place() -> Vector2:
	return _from.lerp(_to, Engine.get_physics_interpolation_fraction())
