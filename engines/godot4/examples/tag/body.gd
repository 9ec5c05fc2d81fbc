extends Node2D
## What chaser and runner have in common: how they move, what they see, when they are done.
##
## Plain circles without a physics body: five pillars and four walls are cheaper to compute here.

const Body := preload("res://examples/tag/body.gd")
const Round := preload("res://examples/tag/round.gd")

## Numbers in an observation.
const OBSERVATION_SIZE := 10 + 3 * Round.NUM_PILLARS
## Divides velocities to about -1 … 1, pixels per second.
const VELOCITY_SCALE := 400.0
## Divides radii of pillars to about 0 … 1, pixels.
const RADIUS_SCALE := 100.0
## Seconds of a round, unless the world's parameter [code]time_limit[/code] says otherwise.
const TIME_LIMIT_S := 10.0

## Radius, pixels.
@export var radius: float = 16.0
## Fastest run, pixels per second.
@export var max_speed: float = 300.0
## How quickly the velocity follows the wish, pixels per second in a second.
@export var acceleration: float = 1000.0
## Which of [member Round.starts] is the place to begin at.
@export var start_index: int = 0

## The round both play.
var game: Round
## The opponent.
var other: Body
## Pixels per second.
var velocity := Vector2.ZERO

var _world: LudusWorld
var _wish := Vector2.ZERO
var _reward: float = 0.0
var _round_number: int = 0


func _ready() -> void:
	_world = LudusWorld.of(self)


## Runs for a tick of [param delta] seconds; pillars and walls stop what is not along them.
func move(delta: float) -> void:
	velocity = velocity.move_toward(_wish * max_speed, acceleration * delta)
	position += velocity * delta
	for i: int in Round.NUM_PILLARS:
		_keep_out(game.pillars[i], game.radii[i] + radius)
	_keep_inside(Round.HALF_SIDE - radius)


## Adds to the reward of the current step.
func earn(reward: float) -> void:
	_reward += reward


## Returns own place and velocity, the opponent's as seen from here, time left, and the pillars.
func get_observation() -> PackedFloat32Array:
	const SIDE := 2.0 * Round.HALF_SIDE
	var place := position
	var to_other := other.position - place
	var seen := PackedFloat32Array(
		[
			place.x / Round.HALF_SIDE,
			place.y / Round.HALF_SIDE,
			velocity.x / VELOCITY_SCALE,
			velocity.y / VELOCITY_SCALE,
			to_other.x / SIDE,
			to_other.y / SIDE,
			other.velocity.x / VELOCITY_SCALE,
			other.velocity.y / VELOCITY_SCALE,
			to_other.length() / (SIDE * sqrt(2.0)),
			game.time_left(),
		]
	)
	for i: int in Round.NUM_PILLARS:
		var to_pillar := game.pillars[i] - place
		seen.append(to_pillar.x / SIDE)
		seen.append(to_pillar.y / SIDE)
		seen.append(game.radii[i] / RADIUS_SCALE)
	return seen


## Returns what the current step has earned.
func get_reward() -> float:
	return _reward


## Returns whether the round is over, or another one has begun without this body.
func is_done() -> bool:
	return game.is_over or game.number != _round_number


## Begins a round, or joins the one that the opponent has just begun.
func reset() -> void:
	if game.number == _round_number:
		var seconds: float = _world.parameters.get("time_limit", TIME_LIMIT_S)
		game.begin(_world.rng, roundi(seconds * Engine.physics_ticks_per_second))
	_round_number = game.number
	position = game.starts[start_index]
	velocity = Vector2.ZERO
	_wish = Vector2.ZERO
	_reward = 0.0


## Chooses where to run: a vector no longer than 1. A step begins, its reward counts from zero.
func _run(wish: Vector2) -> void:
	_wish = wish
	_reward = 0.0


func _keep_out(centre: Vector2, room: float) -> void:
	var away := position - centre
	if away.length_squared() >= room * room:
		return
	var normal := away.normalized() if away != Vector2.ZERO else Vector2.UP
	position = centre + normal * room
	if velocity.dot(normal) < 0.0:
		velocity = velocity.slide(normal)


func _keep_inside(reach: float) -> void:
	if absf(position.x) > reach:
		position.x = clampf(position.x, -reach, reach)
		velocity.x = 0.0
	if absf(position.y) > reach:
		position.y = clampf(position.y, -reach, reach)
		velocity.y = 0.0
