extends CharacterBody2D
## Runs after its ball and sees walls with the sixteen rays of its sensor.
##
## Chasers pass through each other; only walls stop them and their rays.

const Arena := preload("res://examples/ball_chase/arena.gd")

## A ball is reached from this far, pixels.
const REACH := 30.0
## Divides distances to the ball to about 0 … 1, pixels.
const DISTANCE_SCALE := 1000.0
const REACH_REWARD := 1.0
## Reward for coming nearer, per pixel.
const PROGRESS_REWARD := 0.002
## Cost of touching a wall, per tick.
const WALL_COST := 0.01

## Speed, pixels per second.
@export var speed: float = 400.0
## A person steers this one with the arrow keys when no trainer is there; the others run straight.
@export var is_hero: bool = false

## Where the ball of this chaser lies, pixels in the arena.
var ball := Vector2.ZERO

var _world: LudusWorld
var _arena: Arena
var _move := Vector2.ZERO
var _distance: float = 0.0
var _reward: float = 0.0

@onready var _rays: LudusRays2D = $Rays


func _ready() -> void:
	_world = LudusWorld.of(self)
	_arena = get_parent()


func _physics_process(_delta: float) -> void:
	velocity = _move * speed
	if move_and_slide():
		_reward -= WALL_COST
	var distance := position.distance_to(ball)
	_reward += (_distance - distance) * PROGRESS_REWARD
	_distance = distance
	if distance < REACH:
		_reward += REACH_REWARD
		_put_ball()


## Runs in a direction: two numbers from -1 to 1. A step begins, and its reward counts from zero.
func apply_action(action: PackedFloat32Array) -> void:
	_move = Vector2(action[0], action[1]).limit_length()
	_reward = 0.0


## Returns how far each ray reaches (0 … 1), where the ball is, and the velocity.
func get_observation() -> PackedFloat32Array:
	var seen := _rays.sense()
	var direction := position.direction_to(ball)
	seen.append(direction.x)
	seen.append(direction.y)
	seen.append(_distance / DISTANCE_SCALE)
	seen.append(velocity.x / speed)
	seen.append(velocity.y / speed)
	return seen


## Returns what the current step has earned: balls and progress, less touched walls.
func get_reward() -> float:
	return _reward


## Returns false: only the step limit ends an episode.
func is_done() -> bool:
	return false


## Puts chaser and ball somewhere in the arena.
func reset() -> void:
	position = _arena.random_place(_world.rng)
	velocity = Vector2.ZERO
	_move = Vector2.ZERO
	_reward = 0.0
	_put_ball()


## Lets a person steer the hero; the others run straight towards their balls.
func get_manual_action() -> PackedFloat32Array:
	var wish := position.direction_to(ball)
	if is_hero:
		wish = Input.get_vector(&"ui_left", &"ui_right", &"ui_up", &"ui_down")
	return PackedFloat32Array([wish.x, wish.y])


func _put_ball() -> void:
	ball = _arena.random_place(_world.rng)
	_distance = position.distance_to(ball)
