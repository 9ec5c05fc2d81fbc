extends Node3D
## Turns the figure of the robot to where it goes, and shows what its rays meet.

## How fast the figure turns, shares of the angle per second.
const TURN_RATE := 12.0

@onready var _robot: CharacterBody3D = get_parent()
@onready var _figure: Node3D = $Figure


func _ready() -> void:
	(_robot.get_node(^"Driver/Rays") as LudusRays3D).draw_in_game(true)


func _process(delta: float) -> void:
	var way := _robot.velocity
	if way.is_zero_approx():
		return
	var angle := atan2(-way.x, -way.z)
	_figure.rotation.y = lerp_angle(_figure.rotation.y, angle, minf(TURN_RATE * delta, 1.0))
