extends LudusSimulation
## An agent on a line runs to a goal, again and again. The whole game is in this script.

## Half the length of the line, metres.
const HALF := 10.0
## The goal is reached from this far, metres.
const REACH := 0.5
## Metres per tick.
const SPEED := 0.4

var _place: float = 0.0
var _goal: float = 0.0
var _speed: float = 0.0
var _reward: float = 0.0


func policy_names() -> PackedStringArray:
	return ["runner"]


func observation_entries(_policy_name: String) -> Array[LudusObservationEntry]:
	return [LudusObservationEntry.create("places", [2])]


## Left, stay, right.
func action_components(_policy_name: String) -> Array[LudusActionComponent]:
	return [LudusActionComponent.discrete("move", 3)]


func max_episode_steps() -> int:
	return 200


func begin_episode() -> void:
	_place = world.rng.randf_range(-HALF, HALF)
	_goal = world.rng.randf_range(-HALF, HALF)
	_speed = 0.0
	_reward = 0.0


func apply_action(_agent: int, action: Variant) -> void:
	_speed = ((action as int) - 1) * SPEED


## A tick passes.
func advance() -> void:
	_place = clampf(_place + _speed, -HALF, HALF)
	if absf(_place - _goal) < REACH:
		_reward += 1.0
		_goal = world.rng.randf_range(-HALF, HALF)


func get_observation(_agent: int) -> Variant:
	return PackedFloat32Array([_place / HALF, (_goal - _place) / HALF])


func get_reward(_agent: int) -> float:
	var reward := _reward
	_reward = 0.0
	return reward
