extends Node3D
## Swings a rod up and keeps it upright with a motor too weak to lift it in one go.
##
## The classic pendulum (length 1 m, mass 1 kg, decisions every 0.05 s) as a real rigid body on a
## hinge. Everything is local to this node, so that copies fit into one physics space.

const InWindow := preload("res://examples/shared/in_window.gd")

## Divides the angular velocity (rad/s) to about -1 … 1.
const ANGULAR_VELOCITY_SCALE := 8.0
## Half the length of the rod, metres.
const ROD_CENTRE := 0.5
const SPEED_COST := 0.1
const TORQUE_COST := 0.001

## Largest torque of the motor, newton metres.
@export var max_torque: float = 2.0
## Largest angular velocity at the start, radians per second.
@export var start_speed: float = 1.0

var _world: LudusWorld
var _torque: float = 0.0

@onready var _rod: RigidBody3D = $Rod


func _ready() -> void:
	_world = LudusWorld.of(self)
	InWindow.show(self)


## Sets the torque of the motor: one number from -1 (clockwise) to 1, times [member max_torque].
func apply_action(action: PackedFloat32Array) -> void:
	_torque = clampf(action[0], -1.0, 1.0) * max_torque
	_rod.constant_torque.z = _torque


## Returns height (1 = up) and side of the tip, and the angular velocity.
func get_observation() -> PackedFloat32Array:
	var tip := _rod.basis.y
	return PackedFloat32Array([tip.y, -tip.x, _rod.angular_velocity.z / ANGULAR_VELOCITY_SCALE])


## Returns minus the cost of angle (radians from upright), speed and torque: 0 at best, about -16.
func get_reward() -> float:
	var tip := _rod.basis.y
	var angle := atan2(-tip.x, tip.y)
	var speed := _rod.angular_velocity.z
	return -(angle * angle + SPEED_COST * speed * speed + TORQUE_COST * _torque * _torque)


## Returns false: only the step limit ends an episode.
func is_done() -> bool:
	return false


## Puts the rod at any angle with a little speed.
func reset() -> void:
	var turned := Basis(Vector3.BACK, _world.rng.randf_range(-PI, PI))
	var speed := _world.rng.randf_range(-start_speed, start_speed)
	_rod.transform = Transform3D(turned, turned.y * ROD_CENTRE)
	_rod.angular_velocity = Vector3(0.0, 0.0, speed)
	_rod.linear_velocity = _rod.angular_velocity.cross(_rod.position)
	# Gravity as a force, so that the game does not depend on the gravity of the project.
	var gravity: float = _world.parameters.get("gravity", 10.0)
	_rod.constant_force = Vector3.DOWN * gravity * _rod.mass
	_rod.constant_torque = Vector3.ZERO
	_torque = 0.0


## Lets a person play with the arrow keys.
func get_manual_action() -> PackedFloat32Array:
	return PackedFloat32Array([Input.get_axis(&"ui_right", &"ui_left")])
