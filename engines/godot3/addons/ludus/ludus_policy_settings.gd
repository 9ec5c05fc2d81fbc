tool
class_name LudusPolicySettings, "res://addons/ludus/icons/ludus_policy_settings.svg"
extends Resource
## Training settings of a policy, chosen in the scene.
##
## Every property left at its default here leaves the choice to the trainer. A configuration file
## and the command line override what the scene says. Where a policy has several agents, the
## settings of the first one count.

## How a policy is trained: PPO (any kind of action; fast with many worlds) or SAC (one discrete
## choice, or numbers; learns from fewer steps).
enum Algorithm { TRAINER_CHOOSES, PPO, SAC }
## Non-linearity between the layers of the network.
enum Activation { TRAINER_CHOOSES, TANH, RELU, ELU, SILU }
## How a policy takes part in training at the start: it learns; it acts as in training, with chance,
## and learns nothing; or it takes its most probable action and learns nothing.
enum Mode { TRAIN, FROZEN, DETERMINISTIC }

## A number that leaves the choice to the trainer.
const UNSET := -1.0

const _PPO_ONLY := [
	"memory_size", "entropy_coefficient", "rollout_steps", "minibatch_size", "epochs"
]
const _SAC_ONLY := ["batch_size", "replay_capacity", "updates_per_step", "temperature"]
const _NUMBERS := ["learning_rate", "discount"]

export(Algorithm) var algorithm: int = Algorithm.TRAINER_CHOOSES
## Whether the policy learns from the start. The game may change it later with
## [method LudusBridge.set_policy_mode].
export(Mode) var mode: int = Mode.TRAIN
## Step size of the optimiser; negative: the trainer's choice.
export var learning_rate: float = UNSET
## Worth of a reward one step later, 0 to 1; negative: the trainer's choice.
export var discount: float = UNSET
## Units of each hidden layer, for example [code][64, 64][/code]; empty: the trainer's choice.
export var hidden_sizes: PoolIntArray = PoolIntArray()
## The same of the critic; empty: as [member hidden_sizes].
export var critic_hidden_sizes: PoolIntArray = PoolIntArray()
export(Activation) var activation: int = Activation.TRAINER_CHOOSES
## Units of a recurrent layer that remembers what the agent saw before; 0: no memory, negative:
## the trainer's choice. PPO only.
export var memory_size: int = -1
## PPO: weight of the entropy bonus, which keeps the policy trying; negative: the trainer's choice.
export var entropy_coefficient: float = UNSET
## PPO: steps of every agent between two updates; negative: the trainer's choice.
export var rollout_steps: int = -1
## PPO: transitions in one gradient step; negative: the trainer's choice.
export var minibatch_size: int = -1
## PPO: passes over the transitions of one update; negative: the trainer's choice.
export var epochs: int = -1
## SAC: transitions in one gradient step; negative: the trainer's choice.
export var batch_size: int = -1
## SAC: newest transitions to keep; negative: the trainer's choice.
export var replay_capacity: int = -1
## SAC: gradient steps for each step of all agents; negative: the trainer's choice.
export var updates_per_step: float = UNSET
## SAC: weight of the entropy; negative: it is learned.
export var temperature: float = UNSET
## Further settings by the trainer's own names, for example
## [code]{"clip_range": 0.1}[/code]. They win over the properties above.
export var more: Dictionary = {}


## Godot 3 lets all instances share the default of an exported array or dictionary.
func _init() -> void:
	more = {}


## Returns what was chosen, by the trainer's names.
func to_json() -> Dictionary:
	var settings := {}
	if algorithm != Algorithm.TRAINER_CHOOSES:
		settings["algorithm"] = _word(Algorithm, algorithm)
	if mode != Mode.TRAIN:
		settings["mode"] = _word(Mode, mode)
	if activation != Activation.TRAINER_CHOOSES:
		settings["activation"] = _word(Activation, activation)
	for name in ["hidden_sizes", "critic_hidden_sizes"]:
		if not get(name).empty():
			settings[name] = Array(get(name))
	for name in _numbers():
		if get(name) >= 0.0:
			settings[name] = get(name)
	for name in more:
		settings[name] = more[name]
	return settings


## Names of the numbers that the chosen algorithm knows.
func _numbers() -> Array:
	return _NUMBERS + (_SAC_ONLY if algorithm == Algorithm.SAC else _PPO_ONLY)


func _word(kind: Dictionary, value: int) -> String:
	var key: String = kind.keys()[value]
	return key.to_lower()
