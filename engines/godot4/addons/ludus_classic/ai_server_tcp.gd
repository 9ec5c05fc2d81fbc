class_name AIServerTCP
extends Node
## What godot-ai's connection to its server can be asked for by a game. Everything else that it did
## is done by the trainer without being asked.


## Looks for a trainer, and starts one if there is none. Returns false if there is one already.
func attempt_connection_to_ai_server() -> bool:
	var training := (get_parent() as AIRunner).training
	if training.state != LudusTraining.State.OFFLINE:
		return false
	training.connect_trainer()
	return true


## Asks for the policies of all agents as files for use in the game. Returns false if no trainer
## listens.
func write_policy(_file_name: String) -> bool:
	return (get_parent() as AIRunner).training.write_policies()


## The most probable action of an agent, by the policy that was written last; empty if none was.
func get_action(file_name: String, state: Array[float]) -> Array[float]:
	var loader := PolicyLoader.new()
	loader.try_to_load_policy_data(file_name)
	if not loader._did_load_policy_data:
		return []
	var network := NeuralNetwork.new(loader._policy_weights, loader._policy_biases)
	return PolicyAgent.new(network).get_action(state, true)
