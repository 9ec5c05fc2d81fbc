extends Spatial
## Turns the apple slowly, so that it catches the eye.

## Radians per second.
const TURN_SPEED := 0.8


func _process(delta: float) -> void:
	rotate_y(TURN_SPEED * delta)
