extends LudusAgent
## An agent that is its own game: a test says what it observes, and reads what it was told.

## Actions it was given.
var applied: Array = []
## What it observes.
var seen = PoolRealArray()
## Its reward.
var reward: float = 0.0
## Whether its episode has ended.
var is_over: bool = false
## Whether its episode was cut off.
var is_cut: bool = false
## What it may do.
var mask := PoolByteArray()
## Number of episodes it has begun.
var num_resets: int = 0


func apply_action(given) -> void:
	applied.append(given)


func get_observation():
	return seen


func get_reward() -> float:
	return reward


func is_done() -> bool:
	return is_over


func is_truncated() -> bool:
	return is_cut


func get_action_mask() -> PoolByteArray:
	return mask


func reset() -> void:
	num_resets += 1


## It has all optional methods, and a test says which of them count.
func has_mask() -> bool:
	return has_action_mask
