@tool
@icon("icons/ludus_policy_settings.svg")
class_name LudusPolicySettings
extends Resource
## Training settings of a policy, chosen in the scene.
##
## Every property left at its default here leaves the choice to the trainer. A configuration file
## and the command line override what the scene says.

## Further settings by the trainer's own names, for example
## [code]{"clip_range": 0.1}[/code]. They win over the properties below.
@export var more: Dictionary = {}
## Units of each hidden layer, for example [code][64, 64][/code]; empty: the trainer's choice.
@export var hidden_sizes: PackedInt32Array = []
## Step size of the optimiser; 0: the trainer's choice.
@export_range(0.0, 1.0, 0.00001, "or_greater") var learning_rate: float = 0.0
## Discount of a reward one step later; 0: the trainer's choice.
@export_range(0.0, 1.0, 0.0001) var discount: float = 0.0
## Weight of the entropy bonus; negative: the trainer's choice.
@export_range(-1.0, 1.0, 0.0001) var entropy_coefficient: float = -1.0


## Returns what was chosen, by the trainer's names.
func to_json() -> Dictionary:
	var settings := {}
	if not hidden_sizes.is_empty():
		settings["hidden_sizes"] = Array(hidden_sizes)
	if learning_rate > 0.0:
		settings["learning_rate"] = learning_rate
	if discount > 0.0:
		settings["discount"] = discount
	if entropy_coefficient >= 0.0:
		settings["entropy_coefficient"] = entropy_coefficient
	settings.merge(more, true)
	return settings
