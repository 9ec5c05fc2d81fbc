extends LudusController3D
## Drives a robot that looks for an apple, which lies at one of several spots of a furnished room.
##
## The robot sees with the sixteen rays of its sensor, which furniture stops: what lies behind the
## shelf is seen by going there. Its observation is that of the sensor alone.

## The apple is caught when its centre is this near to the robot's, metres.
const REACH := 0.9
const CATCH_REWARD := 100.0
## Directions of the actions: right (+x), left, up (-z, away from the camera), down.
const MOVES: Array[Vector3] = [Vector3.RIGHT, Vector3.LEFT, Vector3.FORWARD, Vector3.BACK]

## Speed of the robot, metres per second.
@export var speed: float = 5.0
## Farthest start from the middle of the start area, along x and along z, metres.
@export var start_offset: float = 0.3

@onready var _robot: CharacterBody3D = get_parent()
@onready var _rays: LudusRays3D = $Rays
@onready var _apple: StaticBody3D = %Apple
@onready var _start: Marker3D = %Start
@onready var _spots: Array[Node] = %Spots.get_children()


## Moves for one tick: 0 to the right, 1 to the left, 2 up, 3 down.
func apply_action(action: int) -> void:
	var own_speed: float = world.parameters.get("speed", speed)
	_robot.velocity = MOVES[action] * own_speed
	_robot.move_and_slide()


## Returns 100 for the apple; before, minus the share of the rays' reach that it seems away.
func get_reward() -> float:
	return CATCH_REWARD if is_done() else -_nearest_apple()


## Returns whether the apple is caught.
func is_done() -> bool:
	var way := _apple.position - _robot.position
	return Vector2(way.x, way.z).length() <= REACH


## Puts the robot into the start area and the apple at one of the spots.
func reset() -> void:
	var offset: float = world.parameters.get("start_offset", start_offset)
	var x := world.rng.randf_range(-offset, offset)
	var z := world.rng.randf_range(-offset, offset)
	var drawn := world.rng.randi_range(0, _spots.size() - 1)
	var spot: int = world.parameters.get("spot", drawn)
	_robot.position = _start.position + Vector3(x, 0.0, z)
	_robot.velocity = Vector3.ZERO
	_apple.position = (_spots[spot] as Marker3D).position


## Lets a person play with the arrow keys; without one the robot stands still.
func get_manual_action() -> Variant:
	var right := Input.get_axis(&"ui_left", &"ui_right")
	var down := Input.get_axis(&"ui_up", &"ui_down")
	if right != 0.0:
		return 0 if right > 0.0 else 1
	if down != 0.0:
		return 3 if down > 0.0 else 2
	return null


## Returns the places of robot and apple, x and z in the room, metres, to test the rules.
func ludus_places() -> Array[float]:
	var robot := _robot.position
	var apple := _apple.position
	return [robot.x, robot.z, apple.x, apple.z]


## The shortest of the rays that meet the apple, as a share of their reach; 1 where none does.
func _nearest_apple() -> float:
	var seen := _rays.sense()
	var nearest := 1.0
	for i: int in range(0, seen.size(), 2):
		if seen[i + 1] > 0.0:
			nearest = minf(nearest, seen[i])
	return nearest
