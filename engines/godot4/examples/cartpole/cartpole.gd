extends Node3D
## Balances a pole that is hinged on a cart by pushing the cart left and right.
##
## The scene of GymGodot, in real rigid-body physics. Everything is local to this node, so that any
## number of copies fit side by side into one physics space.

const InWindow := preload("res://examples/shared/in_window.gd")

## The cart may go this far from the middle of the track, metres.
const TRACK_HALF_LENGTH := 40.0
## The pole may lean this far, radians.
const MAX_ANGLE := PI / 8.0
## The hinge, seen from the centre of the cart, metres.
const HINGE := Vector3(0.0, -1.0, 0.0)
## From the hinge to the centre of the pole, metres.
const POLE_CENTRE_HEIGHT := 7.0
## Divide position (m), velocity (m/s), angle (rad) and angular velocity (rad/s) to about -1 … 1.
const POSITION_SCALE := TRACK_HALF_LENGTH
const VELOCITY_SCALE := 20.0
const ANGULAR_VELOCITY_SCALE := 2.0

## Push on the cart, newtons: in one tick at 60/s an impulse of 2 N s.
@export var push_force: float = 120.0
## Farthest start from the middle, metres.
@export var start_offset: float = 1.0
## Largest lean at the start, radians.
@export var start_angle: float = 0.05

var _world: LudusWorld
var _idle_push: int = 0

@onready var _cart: RigidBody3D = $Cart
@onready var _pole: RigidBody3D = $Pole


func _ready() -> void:
	_world = LudusWorld.of(self)
	InWindow.show(self)


## Pushes towards -z (0) or +z (1), with the same force until the next call.
func apply_action(action: int) -> void:
	_cart.constant_force.z = push_force if action == 1 else -push_force


## Returns position and velocity of the cart, angle and angular velocity of the pole.
func get_observation() -> PackedFloat32Array:
	return PackedFloat32Array(
		[
			_cart.position.z / POSITION_SCALE,
			_cart.linear_velocity.z / VELOCITY_SCALE,
			_pole.rotation.x / MAX_ANGLE,
			_pole.angular_velocity.x / ANGULAR_VELOCITY_SCALE,
		]
	)


## Returns 1 for every step.
func get_reward() -> float:
	return 1.0


## Returns whether the cart has left the track or the pole has fallen.
func is_done() -> bool:
	return absf(_cart.position.z) > TRACK_HALF_LENGTH or absf(_pole.rotation.x) > MAX_ANGLE


## Puts the cart near the middle and the pole almost upright, both at rest.
func reset() -> void:
	var z := _world.rng.randf_range(-start_offset, start_offset)
	var lean := Basis(Vector3.RIGHT, _world.rng.randf_range(-start_angle, start_angle))
	var hinge := HINGE + Vector3(0.0, 0.0, z)
	_put(_cart, Transform3D(Basis.IDENTITY, Vector3(0.0, 0.0, z)))
	_put(_pole, Transform3D(lean, hinge + lean.y * POLE_CENTRE_HEIGHT))
	# Gravity as a force, so that the game does not depend on the gravity of the project.
	var gravity: float = _world.parameters.get("gravity", 3.7)
	_pole.constant_force = Vector3.DOWN * gravity * _pole.mass
	_cart.constant_force = Vector3.ZERO


## Lets a person play with the arrow keys. Nothing pressed: left and right in turn.
func get_manual_action() -> int:
	var direction := Input.get_axis(&"ui_left", &"ui_right")
	if direction != 0.0:
		return 1 if direction > 0.0 else 0
	_idle_push = 1 - _idle_push
	return _idle_push


func _put(body: RigidBody3D, place: Transform3D) -> void:
	body.transform = place
	body.linear_velocity = Vector3.ZERO
	body.angular_velocity = Vector3.ZERO
