# gdlint: disable=class-variable-name
class_name Replay
extends RefCounted
## A transition, as games for godot-ai know it. Ludus does not need it: transitions reach the
## trainer as they happen.

## What the agent saw.
var state: Array[float]
## What it did.
var action: Array[float]
## What it got.
var reward: float
## What it saw then.
var state_: Array[float]
## 1 if its game was over, otherwise 0.
var done: int
## Name of the agent.
var agent_name: String = ""
## Numbers are rounded to multiples of this.
var rounding_precision: float = 0.0001


func _init(
	before: Array[float],
	decision: Array[float],
	score: float,
	after: Array[float],
	is_done: bool,
) -> void:
	state = _rounded(before)
	action = _rounded(decision)
	reward = snappedf(score, rounding_precision)
	state_ = _rounded(after)
	done = int(is_done)


## The transition as a dictionary; the agent's name is left out where it is empty.
func to_data() -> Dictionary:
	var data := {"state": state, "action": action, "reward": reward, "state_": state_, "done": done}
	if not agent_name.is_empty():
		data["agent_name"] = agent_name
	return data


func _rounded(numbers: Array[float]) -> Array[float]:
	var rounded: Array[float] = []
	for number: float in numbers:
		rounded.append(snappedf(number, rounding_precision))
	return rounded
