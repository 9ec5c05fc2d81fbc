extends Spatial
## Swings a rod up and keeps it upright with a motor too weak to lift it in one go.
##
## The classic pendulum (length 1 m, mass 1 kg, decisions every 0.05 s) as a real rigid body on a
## hinge. Everything is local to this node, so that copies fit into one physics space. Nodes show
## what Bullet had one tick ago, so the state is read from the physics server.

const InWindow := preload("res://examples/shared/in_window.gd")

## Divides the angular velocity (rad/s) to about -1 … 1.
const ANGULAR_VELOCITY_SCALE := 8.0
## Half the length of the rod, metres.
const ROD_CENTRE := 0.5
const SPEED_COST := 0.1
const TORQUE_COST := 0.001
const PLACE := PhysicsServer.BODY_STATE_TRANSFORM
const ANGULAR_VELOCITY := PhysicsServer.BODY_STATE_ANGULAR_VELOCITY
const GRAVITY_SETTING := "physics/3d/default_gravity"

## Largest torque of the motor, newton metres.
export var max_torque: float = 2.0
## Largest angular velocity at the start, radians per second.
export var start_speed: float = 1.0

var _world: LudusWorld
var _torque: float = 0.0

onready var _rod: RigidBody = $Rod
onready var _body: RID = _rod.get_rid()


func _ready() -> void:
	_world = LudusWorld.of(self)
	_set_gravity()
	InWindow.show(self)


## Turns the motor in this tick: one number from -1 (clockwise) to 1, times [member max_torque].
func apply_action(action: PoolRealArray) -> void:
	_torque = clamp(action[0], -1.0, 1.0) * max_torque
	_rod.add_torque(Vector3(0.0, 0.0, _torque))


## Returns height (1 = up) and side of the tip, and the angular velocity.
func get_observation() -> PoolRealArray:
	var tip := _tip()
	return PoolRealArray([tip.y, -tip.x, _speed() / ANGULAR_VELOCITY_SCALE])


## Returns minus the cost of angle (radians from upright), speed and torque: 0 at best, about -16.
func get_reward() -> float:
	var tip := _tip()
	var angle := atan2(-tip.x, tip.y)
	var speed := _speed()
	return -(angle * angle + SPEED_COST * speed * speed + TORQUE_COST * _torque * _torque)


## Returns false: only the step limit ends an episode.
func is_done() -> bool:
	return false


## Puts the rod at any angle with a little speed.
func reset() -> void:
	var turned := Basis(Vector3.BACK, _world.rng.randf_range(-PI, PI))
	var speed := _world.rng.randf_range(-start_speed, start_speed)
	_rod.transform = Transform(turned, turned.y * ROD_CENTRE)
	_rod.force_update_transform()
	_rod.angular_velocity = Vector3(0.0, 0.0, speed)
	_rod.linear_velocity = _rod.angular_velocity.cross(_rod.translation)
	_set_gravity()
	_torque = 0.0


## Lets a person play with the arrow keys.
func get_manual_action() -> PoolRealArray:
	return PoolRealArray([Input.get_axis("ui_right", "ui_left")])


## The game does not depend on the gravity of the project. Bullet notices a change one tick late.
func _set_gravity() -> void:
	var gravity: float = _world.parameters.get("gravity", 10.0)
	_rod.gravity_scale = gravity / ProjectSettings.get(GRAVITY_SETTING)


## Direction of the tip.
func _tip() -> Vector3:
	var place: Transform = PhysicsServer.body_get_state(_body, PLACE)
	return place.basis.y


## Angular velocity, radians per second.
func _speed() -> float:
	var turning: Vector3 = PhysicsServer.body_get_state(_body, ANGULAR_VELOCITY)
	return turning.z
