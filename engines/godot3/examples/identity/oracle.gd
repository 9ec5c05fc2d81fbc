extends Node2D
## Answers every step with numbers that a test can predict.
##
## Observation: [code][episode, step, last action, first random number, ticks][/code]; the
## reward is the number of the step times [constant REWARD_PER_STEP].

const REWARD_PER_STEP := 0.1
## What the observation shows as the last action before there was one.
const NO_ACTION := -1

## Steps until the episode terminates, unless the parameter [member length_key] says otherwise.
export var length: int = 5
## World parameter with the number of steps until the episode terminates; 0: never.
export var length_key: String = "length"
## World parameter with the step in which this node leaves the scene; missing: it stays.
export var leave_key: String = ""

var _world: LudusWorld
var _episode: int = 0
var _step: int = 0
var _last_action: int = NO_ACTION
var _first_random: float = 0.0
var _ticks: int = 0


func _ready() -> void:
	_world = LudusWorld.of(self)


func _physics_process(_delta: float) -> void:
	_ticks += 1


## Counts a step and remembers the action.
func apply_action(action: int) -> void:
	_step += 1
	_last_action = action
	if not leave_key.empty() and _step == int(_world.parameters.get(leave_key, 0)):
		queue_free()


## Returns episode (1 is the first after a seeded reset), step, last action, the first random
## number of the episode (0 … 1) and the ticks since the episode began.
func get_observation() -> PoolRealArray:
	return PoolRealArray([_episode, _step, _last_action, _first_random, _ticks])


## Returns the number of the step times [constant REWARD_PER_STEP].
func get_reward() -> float:
	return _step * REWARD_PER_STEP


## Returns whether the episode has terminated.
func is_done() -> bool:
	return _has_reached(int(_world.parameters.get(length_key, length)))


## Returns whether the episode is cut off: after as many steps as the world's parameter
## [code]truncate_after[/code] says.
func is_truncated() -> bool:
	return _has_reached(int(_world.parameters.get("truncate_after", 0)))


## Begins an episode.
func reset() -> void:
	_episode = _world.num_episodes
	_step = 0
	_last_action = NO_ACTION
	_first_random = _world.rng.randf()
	_ticks = 0


func _has_reached(limit: int) -> bool:
	return limit > 0 and _step >= limit
