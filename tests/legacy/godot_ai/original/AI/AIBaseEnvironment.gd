class_name AIBaseEnvironment
extends CanvasItem

## Stands for godot-ai's class in tests: written anew, with the methods that games override.

var _ai_runner = AIRunner.new()


func _ready():
	_ai_runner.env_delegate = self
	add_child(_ai_runner)


func new_simulation() -> BaseSimulation:
	return null


func display_simulation(_simulation: BaseSimulation):
	pass


func get_number_of_simulations_to_display() -> int:
	return 1


func get_simulation_count() -> int:
	return 1


func get_steps_in_round() -> int:
	return 1


func get_agent_names() -> Array[String]:
	return []


func get_state_dim(_agent_name: String) -> int:
	return 0


func get_action_dim(_agent_name: String) -> int:
	return 0


func get_batch_size(_agent_name: String) -> int:
	return 0


func get_num_actor_layers(_agent_name: String) -> int:
	return 0


func get_num_critic_layers(_agent_name: String) -> int:
	return 0


func get_hidden_size(_agent_name: String) -> int:
	return 0


func get_replay_capacity(_agent_name) -> int:
	return 0


func get_train_steps(_agent_name: String) -> int:
	return 0


func get_is_deterministic_map(_epoch: int) -> Dictionary:
	return {}


func update_status(_epoch: int, _message: String):
	pass
