extends Spatial
## Balances a pole that is hinged on a cart by pushing the cart left and right.
##
## The very scene of GymGodot: its geometry, masses, joint and forces in Bullet. Everything is local
## to this node, so that any number of copies fit side by side into one physics space. Nodes show
## what Bullet had one tick ago, so the state is read from the physics server.

const InWindow := preload("res://examples/shared/in_window.gd")

## The cart may go this far from the middle of the track, metres.
const TRACK_HALF_LENGTH := 40.0
## The pole may lean this far, radians.
const MAX_ANGLE := PI / 8.0
## From the hinge, in the centre of the cart, to the centre of the pole, metres.
const POLE_CENTRE_HEIGHT := 6.0
## The pole feels gravity this many times.
const POLE_GRAVITY_SCALE := 14.0
const PLACE := PhysicsServer.BODY_STATE_TRANSFORM
const VELOCITY := PhysicsServer.BODY_STATE_LINEAR_VELOCITY
const ANGULAR_VELOCITY := PhysicsServer.BODY_STATE_ANGULAR_VELOCITY
const GRAVITY_SETTING := "physics/3d/default_gravity"
## Divide position (m), velocity (m/s), angle (rad) and angular velocity (rad/s) to about -1 … 1.
const POSITION_SCALE := TRACK_HALF_LENGTH
const VELOCITY_SCALE := 20.0
const ANGULAR_VELOCITY_SCALE := 2.0

## Push on the cart in every tick, newton seconds.
export var push_impulse: float = 2.0
## Farthest start from the middle, metres.
export var start_offset: float = 1.0
## Largest lean at the start, radians.
export var start_angle: float = 0.05

var _world: LudusWorld
## Where the middle of the track lies in the physics space.
var _middle: float = 0.0
var _idle_push: int = 0

onready var _cart: RigidBody = $Cart
onready var _pole: RigidBody = $Pole
onready var _cart_body: RID = _cart.get_rid()
onready var _pole_body: RID = _pole.get_rid()


func _ready() -> void:
	_world = LudusWorld.of(self)
	_middle = global_transform.origin.z
	_set_gravity()
	InWindow.show(self)


## Pushes towards -z (0) or +z (1) in this tick.
func apply_action(action: int) -> void:
	_cart.apply_central_impulse(Vector3(0.0, 0.0, push_impulse if action == 1 else -push_impulse))


## Returns position and velocity of the cart, angle and angular velocity of the pole.
func get_observation() -> PoolRealArray:
	var velocity: Vector3 = PhysicsServer.body_get_state(_cart_body, VELOCITY)
	var turning: Vector3 = PhysicsServer.body_get_state(_pole_body, ANGULAR_VELOCITY)
	return PoolRealArray(
		[
			_position() / POSITION_SCALE,
			velocity.z / VELOCITY_SCALE,
			_lean() / MAX_ANGLE,
			turning.x / ANGULAR_VELOCITY_SCALE,
		]
	)


## Returns 1 for every step.
func get_reward() -> float:
	return 1.0


## Returns whether the cart has left the track or the pole has fallen.
func is_done() -> bool:
	return abs(_position()) > TRACK_HALF_LENGTH or abs(_lean()) > MAX_ANGLE


## Puts the cart near the middle and the pole almost upright, both at rest.
func reset() -> void:
	var offset: float = _world.parameters.get("start_offset", start_offset)
	var angle: float = _world.parameters.get("start_angle", start_angle)
	var z := _world.rng.randf_range(-offset, offset)
	var lean := Basis(Vector3.RIGHT, _world.rng.randf_range(-angle, angle))
	_put(_cart, Transform(Basis.IDENTITY, Vector3(0.0, 0.0, z)))
	_put(_pole, Transform(lean, Vector3(0.0, 0.0, z) + lean.y * POLE_CENTRE_HEIGHT))
	_set_gravity()


## Lets a person play with the arrow keys. Nothing pressed: left and right in turn.
func get_manual_action() -> int:
	var direction := Input.get_axis("ui_left", "ui_right")
	if direction != 0.0:
		return 1 if direction > 0.0 else 0
	_idle_push = 1 - _idle_push
	return _idle_push


## Returns cart position (m) and pole angle (rad), as they are.
func get_state() -> Array:
	return [_position(), _lean()]


## The game does not depend on the gravity of the project. Bullet notices a change one tick late.
func _set_gravity() -> void:
	var gravity: float = _world.parameters.get("gravity", 3.7)
	_pole.gravity_scale = POLE_GRAVITY_SCALE * gravity / ProjectSettings.get(GRAVITY_SETTING)


func _position() -> float:
	var place: Transform = PhysicsServer.body_get_state(_cart_body, PLACE)
	return place.origin.z - _middle


func _lean() -> float:
	var place: Transform = PhysicsServer.body_get_state(_pole_body, PLACE)
	return atan2(place.basis.y.z, place.basis.y.y)


func _put(body: RigidBody, place: Transform) -> void:
	body.transform = place
	body.force_update_transform()
	body.linear_velocity = Vector3.ZERO
	body.angular_velocity = Vector3.ZERO
