extends Spatial
## A robot looks for an apple that lies at one of several spots of a furnished room.
##
## It feels its way with sixteen rays, which furniture stops: what lies behind the shelf is seen by
## who goes there. Everything is local to this node, so that any number of copies fit side by side
## into one physics space.

const InWindow := preload("res://examples/shared/in_window.gd")

## Number of rays, evenly around the robot; the first points to +x, the next ones turn towards +z.
const NUM_RAYS := 16
## A ray sees this far from the centre of the robot, metres. What it does not meet is this far away.
const SIGHT := 5.0
## The apple is caught when its centre is this near to the robot's, metres.
const REACH := 0.9
const CATCH_REWARD := 100.0
## Directions of the actions: right (+x), left, up (-z, away from the camera), down.
const MOVES := [Vector3.RIGHT, Vector3.LEFT, Vector3.FORWARD, Vector3.BACK]
## The action of a person who presses no key; a trainer has no such choice.
const STAY := -1

## Speed of the robot, metres per second.
export var speed: float = 5.0
## Farthest start from the middle of the start area, along x and along z, metres.
export var start_offset: float = 0.3

## How far each ray reaches, metres.
var distances_to_obstacle := PoolRealArray()
## How far away the apple is along each ray; [constant SIGHT] where the ray does not meet it.
var distances_to_target := PoolRealArray()
## Where the robot looks, as it moved last.
var heading: Vector3 = Vector3.BACK

var _world: LudusWorld
## Shortest of [member distances_to_target], metres.
var _nearest: float = SIGHT
## Whether anything has moved since the rays were cast.
var _is_stale: bool = true
var _ray_ends := PoolVector3Array()

onready var _robot: KinematicBody = $Robot
onready var _ray: RayCast = $Robot/Ray
onready var _apple: StaticBody = $Apple
onready var _start: Position3D = $Start
onready var _spots: Array = $Spots.get_children()


func _ready() -> void:
	_world = LudusWorld.of(self)
	distances_to_obstacle.resize(NUM_RAYS)
	distances_to_target.resize(NUM_RAYS)
	for i in NUM_RAYS:
		_ray_ends.append(Vector3.RIGHT.rotated(Vector3.DOWN, TAU * i / NUM_RAYS) * SIGHT)
	InWindow.show(self)


## Moves for one tick: 0 to the right, 1 to the left, 2 up, 3 down.
func apply_action(action: int) -> void:
	_is_stale = true
	if action == STAY:
		return
	heading = MOVES[action]
	var own_speed: float = _world.parameters.get("speed", speed)
	var _velocity := _robot.move_and_slide(heading * own_speed, Vector3.UP)


## Returns the distances to what each ray meets and to the apple, metres.
func get_observation() -> Dictionary:
	_look()
	return {
		"distances_to_obstacle": distances_to_obstacle,
		"distances_to_target": distances_to_target,
	}


## Returns 100 for the apple; before, minus the share of [constant SIGHT] that it seems away.
func get_reward() -> float:
	if is_done():
		return CATCH_REWARD
	_look()
	return -_nearest / SIGHT


## Returns whether the apple is caught.
func is_done() -> bool:
	var way := _apple.translation - _robot.translation
	return Vector2(way.x, way.z).length() <= REACH


## Puts the robot into the start area and the apple at one of the spots.
func reset() -> void:
	var offset: float = _world.parameters.get("start_offset", start_offset)
	var x := _world.rng.randf_range(-offset, offset)
	var z := _world.rng.randf_range(-offset, offset)
	var drawn := _world.rng.randi_range(0, _spots.size() - 1)
	var spot: int = _world.parameters.get("spot", drawn)
	_put(_robot, _start.translation + Vector3(x, 0.0, z))
	_put(_apple, _spots[spot].translation)
	_show_to_rays(_apple)
	heading = Vector3.BACK
	_is_stale = true


## Lets a person play with the arrow keys.
func get_manual_action() -> int:
	var right := Input.get_axis("ui_left", "ui_right")
	var down := Input.get_axis("ui_up", "ui_down")
	if right != 0.0:
		return 0 if right > 0.0 else 1
	if down != 0.0:
		return 3 if down > 0.0 else 2
	return STAY


## Returns the places of robot and apple, x and z in the room, metres.
func get_state() -> Array:
	var robot := _robot.translation
	var apple := _apple.translation
	return [robot.x, robot.z, apple.x, apple.z]


## Puts the robot somewhere, to try something out.
func put_robot(x: float, z: float) -> void:
	_put(_robot, Vector3(x, _robot.translation.y, z))
	_is_stale = true


## Casts the rays if anything has moved. One ray node is turned sixteen times, and only when
## somebody asks: an enabled RayCast would work in every tick, a query of the space make a
## Dictionary.
func _look() -> void:
	if not _is_stale:
		return
	_is_stale = false
	_nearest = SIGHT
	var eye := _ray.global_transform.origin
	for i in NUM_RAYS:
		_ray.cast_to = _ray_ends[i]
		_ray.force_raycast_update()
		var is_hit := _ray.is_colliding()
		var distance := eye.distance_to(_ray.get_collision_point()) if is_hit else SIGHT
		var is_target := is_hit and _ray.get_collider() == _apple
		distances_to_obstacle[i] = distance
		distances_to_target[i] = distance if is_target else SIGHT
		if is_target:
			_nearest = min(_nearest, distance)


## Without the second line the physics server hears of the new place only at the end of the tick.
func _put(body: PhysicsBody, place: Vector3) -> void:
	body.translation = place
	body.force_update_transform()


## Bullet looks for a body that rays may meet where it was at the end of the last tick, unless it is
## new to its layer.
static func _show_to_rays(body: PhysicsBody) -> void:
	var layer := body.collision_layer
	body.collision_layer = 0
	body.collision_layer = layer
