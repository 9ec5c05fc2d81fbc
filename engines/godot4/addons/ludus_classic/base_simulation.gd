# gdlint: disable=max-public-methods
class_name BaseSimulation
extends RefCounted
## One game that was written for godot-ai: agents by index, no nodes.
##
## The methods are those of godot-ai and are to be overridden. [LudusClassicSimulation] plays it.

## Whether [method cleanup_simulation] was called; the game sets it.
var _is_cleaned: bool = false


## Begins the game, once. May be a coroutine that awaits [param physics_update], which comes when a
## physics tick has passed.
func new_game(physics_update: Signal) -> bool:
	_say_missing("new_game")
	await physics_update
	return true


## Whether an agent's game is over; it then waits for the end of the round.
func is_game_complete(_agent_index: int) -> bool:
	_say_missing("is_game_complete")
	return false


## Takes an agent's decision, once per step; [param _callback] is null.
func apply_action(_agent_index: int, _action_vector: Array[float], _callback: Variant) -> void:
	_say_missing("apply_action")


## What an agent sees.
func get_state(_agent_index: int) -> Array[float]:
	_say_missing("get_state")
	return []


## An agent's reward for the last step.
func get_score(_agent_index: int) -> float:
	_say_missing("get_score")
	return 0.0


## Frees everything. Called once.
func cleanup_simulation() -> void:
	_say_missing("cleanup_simulation")


## How many numbers an agent observes. Not asked by Ludus: the environment says so, too.
func get_state_dim(_agent_name: String) -> int:
	_say_missing("get_state_dim")
	return 0


## How many numbers an agent decides. Not asked by Ludus: the environment says so, too.
func get_action_dim(_agent_name: String) -> int:
	_say_missing("get_action_dim")
	return 0


## Names of all agents. Not asked by Ludus: the environment says so, too.
func get_agent_names() -> Array[String]:
	_say_missing("get_agent_names")
	return []


## How many agents there are, always the same.
func get_agents_count() -> int:
	_say_missing("get_agents_count")
	return 0


## Name of an agent, always the same.
func get_agent_name(_agent_index: int) -> String:
	_say_missing("get_agent_name")
	return ""


func _say_missing(method: String) -> void:
	push_error(
		"ludus: %s does not override %s()" % [(get_script() as Script).resource_path, method]
	)
