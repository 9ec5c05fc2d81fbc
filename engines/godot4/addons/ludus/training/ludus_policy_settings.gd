@tool
@icon("res://addons/ludus/icons/ludus_policy_settings.svg")
class_name LudusPolicySettings
extends Resource
## Training settings of a policy, chosen in the scene.
##
## Every property left at its default here leaves the choice to the trainer. A configuration file
## and the command line override what the scene says. Where a policy has several agents, the
## settings of the first one count.

## How a policy is trained.
enum Algorithm {
	TRAINER_CHOOSES,  ## PPO, unless file or command line say otherwise.
	PPO,  ## Proximal policy optimisation: any kind of action; fast with many worlds.
	SAC,  ## Soft actor-critic: one discrete choice, or numbers; learns from fewer steps.
}
## Non-linearity between the layers of the network.
enum Activation { TRAINER_CHOOSES, TANH, RELU, ELU, SILU }
## How a policy takes part in training at the start.
enum Mode {
	TRAIN,  ## It learns.
	FROZEN,  ## It acts as in training, with chance, and learns nothing.
	DETERMINISTIC,  ## It takes its most probable action and learns nothing.
}

## A number that leaves the choice to the trainer.
const UNSET := -1.0

const _PPO_ONLY: Array[StringName] = [
	&"memory_size", &"entropy_coefficient", &"rollout_steps", &"minibatch_size", &"epochs"
]
const _SAC_ONLY: Array[StringName] = [
	&"batch_size", &"replay_capacity", &"updates_per_step", &"temperature"
]
const _NUMBERS: Array[StringName] = [&"learning_rate", &"discount", &"frame_stack"]

## How the policy learns.
@export var algorithm: LudusPolicySettings.Algorithm = Algorithm.TRAINER_CHOOSES:
	set(value):
		algorithm = value
		notify_property_list_changed()
## Whether the policy learns from the start. The game may change it later with
## [code]Ludus.set_policy_mode()[/code].
@export var mode: LudusPolicySettings.Mode = Mode.TRAIN
## Step size of the optimiser; negative: the trainer's choice.
@export_range(-1.0, 1.0, 0.00001, "or_greater") var learning_rate: float = UNSET
## Worth of a reward one step later, 0 to 1; negative: the trainer's choice.
@export_range(-1.0, 1.0, 0.0001) var discount: float = UNSET

@export_group("Network")
## Units of each hidden layer, for example [code][64, 64][/code]; empty: the trainer's choice.
@export var hidden_sizes: PackedInt32Array = []
## The same of the critic; empty: as [member hidden_sizes].
@export var critic_hidden_sizes: PackedInt32Array = []
## Non-linearity between the layers.
@export var activation: LudusPolicySettings.Activation = Activation.TRAINER_CHOOSES
## Observations that the network sees together, the last ones of the episode: 4 show how things
## move; 1: the newest only, negative: the trainer's choice.
@export_range(-1, 64, 1, "or_greater") var frame_stack: int = -1
## Units of a recurrent layer that remembers what the agent saw before; 0: no memory, negative:
## the trainer's choice. PPO only.
@export_range(-1, 512, 1, "or_greater") var memory_size: int = -1

@export_group("PPO")
## Weight of the entropy bonus, which keeps the policy trying; negative: the trainer's choice.
@export_range(-1.0, 1.0, 0.0001) var entropy_coefficient: float = UNSET
## Steps of every agent between two updates; negative: the trainer's choice.
@export_range(-1, 4096, 1, "or_greater") var rollout_steps: int = -1
## Transitions in one gradient step; negative: the trainer's choice.
@export_range(-1, 65536, 1, "or_greater") var minibatch_size: int = -1
## Passes over the transitions of one update; negative: the trainer's choice.
@export_range(-1, 64, 1, "or_greater") var epochs: int = -1

@export_group("SAC")
## Transitions in one gradient step; negative: the trainer's choice.
@export_range(-1, 65536, 1, "or_greater") var batch_size: int = -1
## Newest transitions to keep; negative: the trainer's choice.
@export_range(-1, 10000000, 1, "or_greater") var replay_capacity: int = -1
## Gradient steps for each step of all agents; negative: the trainer's choice.
@export_range(-1.0, 64.0, 0.01, "or_greater") var updates_per_step: float = UNSET
## Weight of the entropy; negative: it is learned.
@export_range(-1.0, 1.0, 0.0001) var temperature: float = UNSET

@export_group("")
## Further settings by the trainer's own names, for example
## [code]{"clip_range": 0.1}[/code]. They win over the properties above.
@export var more: Dictionary = {}


## Returns what was chosen, by the trainer's names.
func to_json() -> Dictionary:
	var settings := {}
	if algorithm != Algorithm.TRAINER_CHOOSES:
		settings["algorithm"] = _word(Algorithm, algorithm)
	if mode != Mode.TRAIN:
		settings["mode"] = _word(Mode, mode)
	if activation != Activation.TRAINER_CHOOSES:
		settings["activation"] = _word(Activation, activation)
	for name: StringName in [&"hidden_sizes", &"critic_hidden_sizes"]:
		var sizes: PackedInt32Array = get(name)
		if not sizes.is_empty():
			settings[str(name)] = Array(sizes)
	for name: StringName in _numbers():
		var number: float = get(name)
		if number >= 0.0:
			settings[str(name)] = get(name)
	settings.merge(more, true)
	return settings


## Names of the numbers that the chosen algorithm knows.
func _numbers() -> Array[StringName]:
	return _NUMBERS + (_SAC_ONLY if algorithm == Algorithm.SAC else _PPO_ONLY)


func _word(kind: Dictionary, value: int) -> String:
	var key: String = kind.find_key(value)
	return key.to_lower()


## Hides what the chosen algorithm does not know.
func _validate_property(property: Dictionary) -> void:
	var name: StringName = property["name"]
	var hidden := _PPO_ONLY if algorithm == Algorithm.SAC else _SAC_ONLY
	if name in hidden:
		property["usage"] = PROPERTY_USAGE_NO_EDITOR
