# gdlint: disable=max-public-methods
class_name AIBaseEnvironment
extends CanvasItem
## Root of a scene that was written for godot-ai: says what is simulated and how it is trained.
##
## The methods are those of godot-ai and are to be overridden. Every simulation becomes a world of
## Ludus (see [LudusClassicSimulation]); this node stays on show and draws some of them.

## Joins the environment with the trainer.
var _ai_runner: AIRunner = AIRunner.new()


func _ready() -> void:
	_ai_runner.env_delegate = self
	add_child(_ai_runner)
	_ai_runner.setup_simulations()


## The scene that a trainer makes worlds of, see its method [code]ludus_world_scene()[/code].
func ludus_world_scene() -> PackedScene:
	return AIRunner.load_world_scene()


## How many simulations are handed to [method display_simulation].
func get_number_of_simulations_to_display() -> int:
	return 1


## Makes one game.
func new_simulation() -> BaseSimulation:
	_say_missing("new_simulation")
	return BaseSimulation.new()


## Shows one game. Called in every frame for each game that is shown, in turn; never without a
## window.
func display_simulation(_simulation: BaseSimulation) -> void:
	_say_missing("display_simulation")


## Steps after which a round ends.
func get_steps_in_round() -> int:
	_say_missing("get_steps_in_round")
	return 20


## How many games are played side by side.
func get_simulation_count() -> int:
	_say_missing("get_simulation_count")
	return 1


## How many numbers an agent observes.
func get_state_dim(_agent_name: String) -> int:
	_say_missing("get_state_dim")
	return 0


## How many numbers from -1 to 1 an agent decides.
func get_action_dim(_agent_name: String) -> int:
	_say_missing("get_action_dim")
	return 0


## Transitions in one gradient step.
func get_batch_size(_agent_name: String) -> int:
	_say_missing("get_batch_size")
	return 0


## Hidden layers of the actor, after the first.
func get_num_actor_layers(_agent_name: String) -> int:
	_say_missing("get_num_actor_layers")
	return 0


## Hidden layers of the critics, after the first.
func get_num_critic_layers(_agent_name: String) -> int:
	_say_missing("get_num_critic_layers")
	return 0


## Units of each hidden layer.
func get_hidden_size(_agent_name: String) -> int:
	_say_missing("get_hidden_size")
	return 0


## Newest transitions to keep.
func get_replay_capacity(_agent_name: String) -> int:
	_say_missing("get_replay_capacity")
	return 0


## Gradient steps for each round.
func get_train_steps(_agent_name: String) -> int:
	_say_missing("get_train_steps")
	return 0


## Tells how training goes, in each epoch "playing", "submitting", "training" and "Done Training".
## [param _epoch] counts rounds from 1.
func update_status(_epoch: int, _message: String) -> void:
	pass


## Names of all agents; those of one name learn together.
func get_agent_names() -> Array[String]:
	_say_missing("get_agent_names")
	return []


## Which agents take their most probable action and learn nothing, by name. Asked once for each
## epoch, before its round.
func get_is_deterministic_map(_epoch: int) -> Dictionary:
	_say_missing("get_is_deterministic_map")
	return {}


func _say_missing(method: String) -> void:
	push_error(
		"ludus: %s does not override %s()" % [(get_script() as Script).resource_path, method]
	)
