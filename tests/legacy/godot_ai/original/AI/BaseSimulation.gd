class_name BaseSimulation
extends RefCounted

## Stands for godot-ai's class in tests: written anew, with the methods that games override.

var _is_cleaned = false


func new_game(physics_update: Signal) -> bool:
	await physics_update
	return true


func get_agents_count() -> int:
	return 0


func get_agent_names() -> Array[String]:
	return []


func get_agent_name(_agent_index: int) -> String:
	return ""


func get_state(_agent_index: int) -> Array[float]:
	return []


func apply_action(_agent_index: int, _action_vector: Array[float], _callback):
	pass


func get_score(_agent_index: int) -> float:
	return 0.0


func is_game_complete(_agent_index: int) -> bool:
	return false


func cleanup_simulation():
	pass
