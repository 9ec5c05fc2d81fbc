extends Spatial
## Balances a pole that is hinged on a cart, as an environment for GymGodot: it pushes the cart left
## or right, and sees both places and how they changed since it looked last.

## Impulse on the cart in every frame.
const PUSH := 2.0
## The cart may go this far.
const MAX_PLACE := 40.0
## The pole may lean this far.
const MAX_LEAN := PI / 8.0
## From the hinge to the centre of the pole.
const POLE_HEIGHT := 6.0

## Largest lean of the pole at the start, radians.
export var start_lean: float = 0.0

var _place: float = 0.0
var _last_place: float = 0.0
var _lean: float = 0.0
var _last_lean: float = 0.0
var _has_failed: bool = false

onready var _cart: RigidBody = $Cart
onready var _pole: RigidBody = $Pole


func _ready() -> void:
	reset()


func _physics_process(_delta: float) -> void:
	_look()


## Pushes towards -z (0) or +z (1).
func apply_action(action: Array) -> void:
	_cart.apply_central_impulse(Vector3(0.0, 0.0, PUSH if action[0] == 1 else -PUSH))


## Returns place and lean, each followed by its change.
func get_observation() -> Array:
	var seen := [_place, _place - _last_place, _lean, _lean - _last_lean]
	_last_place = _place
	_last_lean = _lean
	return seen


## Returns 1 for every step.
func get_reward() -> float:
	return 1.0


## Returns whether the cart has left the track or the pole has fallen.
func is_done() -> bool:
	return _has_failed


## Puts the cart into the middle, with the pole upright, or almost.
func reset() -> void:
	var lean := Basis(Vector3.RIGHT, rand_range(-start_lean, start_lean))
	_put(_cart, Transform.IDENTITY)
	_put(_pole, Transform(lean, lean.y * POLE_HEIGHT))
	_has_failed = false
	_look()
	_last_place = _place
	_last_lean = _lean


func _look() -> void:
	var up := _pole.transform.basis.y
	_place = _cart.transform.origin.z
	_lean = atan2(up.z, up.y)
	_has_failed = _has_failed or abs(_place) > MAX_PLACE or abs(_lean) > MAX_LEAN


func _put(body: RigidBody, place: Transform) -> void:
	body.transform = place
	body.linear_velocity = Vector3.ZERO
	body.angular_velocity = Vector3.ZERO
