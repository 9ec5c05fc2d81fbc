class_name LudusClassicSettings
extends RefCounted
## Training settings of an agent of an [AIBaseEnvironment]: those that the environment names, and
## for the rest those of godot-ai, as [code]ludus serve --bridge godot-ai[/code] has them.

const LEARNING_RATE := 3e-4
const DISCOUNT := 0.99
const TARGET_RATE := 0.005


## Returns the settings of the agents of a name.
static func of(environment: AIBaseEnvironment, agent_name: String) -> LudusPolicySettings:
	var settings := LudusPolicySettings.new()
	var units := environment.get_hidden_size(agent_name)
	var steps := maxi(environment.get_steps_in_round(), 1)
	settings.algorithm = LudusPolicySettings.Algorithm.SAC
	settings.activation = LudusPolicySettings.Activation.RELU
	settings.learning_rate = LEARNING_RATE
	settings.discount = DISCOUNT
	settings.hidden_sizes = _layers(units, environment.get_num_actor_layers(agent_name))
	settings.critic_hidden_sizes = _layers(units, environment.get_num_critic_layers(agent_name))
	settings.batch_size = environment.get_batch_size(agent_name)
	settings.replay_capacity = maxi(
		environment.get_replay_capacity(agent_name), settings.batch_size
	)
	settings.updates_per_step = float(environment.get_train_steps(agent_name)) / steps
	settings.more = {
		"target_rate": TARGET_RATE,
		"target_entropy": -float(environment.get_action_dim(agent_name)),
		"learning_starts": 0,
		"normalise_observation": false,
		"save_replay": false,
		# So that an update is a round, and checkpoints have the numbers of epochs.
		"report_steps": steps,
	}
	return settings


static func _layers(units: int, num_after_first: int) -> PackedInt32Array:
	var sizes := PackedInt32Array()
	sizes.resize(num_after_first + 1)
	sizes.fill(units)
	return sizes
