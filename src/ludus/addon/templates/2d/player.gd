extends CharacterBody2D
## Collects coins. What it sees, its sensors say; this script says what it does and what counts.

## Pixels per second.
const SPEED := 250.0
## A coin is collected from this far, pixels.
const REACH := 20.0
## Reward for coming nearer to the nearest coin, per pixel.
const PROGRESS := 0.01
## Half the size of the room, less a margin.
const ROOM := Vector2(290.0, 150.0)

var _move := Vector2.ZERO
var _reward: float = 0.0
var _nearest: float = INF

@onready var _world := LudusWorld.of(self)
@onready var _coins := $"../Coins".get_children()


func _physics_process(_delta: float) -> void:
	velocity = _move * SPEED
	move_and_slide()
	var nearest := INF
	for coin: Node2D in _coins:
		var distance := coin.position.distance_to(position)
		nearest = minf(nearest, distance)
		if distance < REACH:
			coin.position = _random_place()
			_reward += 1.0
			nearest = INF
			break
	if is_finite(nearest) and is_finite(_nearest):
		_reward += (_nearest - nearest) * PROGRESS
	_nearest = nearest


## The agent has decided: two numbers from -1 to 1. A step begins.
func apply_action(action: PackedFloat32Array) -> void:
	_move = Vector2(action[0], action[1]).limit_length()
	_reward = 0.0


## What the step was worth.
func get_reward() -> float:
	return _reward


## Only max_episode_steps of the LudusAgent ends an episode.
func is_done() -> bool:
	return false


## Puts everything back for the next episode. All randomness comes from the world.
func reset() -> void:
	position = _random_place()
	velocity = Vector2.ZERO
	_move = Vector2.ZERO
	_reward = 0.0
	_nearest = INF
	for coin: Node2D in _coins:
		coin.position = _random_place()


## What a person wants, while no trainer is there.
func get_manual_action() -> PackedFloat32Array:
	var wish := Input.get_vector(&"ui_left", &"ui_right", &"ui_up", &"ui_down")
	return PackedFloat32Array([wish.x, wish.y])


func _random_place() -> Vector2:
	var x := _world.rng.randf_range(-ROOM.x, ROOM.x)
	return Vector2(x, _world.rng.randf_range(-ROOM.y, ROOM.y))
