class_name RLAgent
extends Spatial
## The agent of an [RLEnvironment], as in godot_gym_api: acts, is reset, and shows what it sees.
##
## Its methods have the signatures of the original, so that scripts written for that still extend
## it.


## Lets the agent stand still while nobody asks for a step; runs before a script's own.
func _ready() -> void:
	pause_mode = Node.PAUSE_MODE_STOP


## Takes an action, any JSON value, which holds for all frames of the step. To be overridden.
func set_action(_action) -> void:
	push_error("%s: override set_action(action)" % get_path())


## Begins an episode. To be overridden; whoever overrides [method RLEnvironment._reset] calls it.
func reset(_arguments = null) -> void:
	pass


## Takes what the client configures. May be overridden.
func configure(_agent_config: Dictionary) -> void:
	pass


## Writes what the agent sees into [param _storage]: a [Dictionary] where answers are JSON, else the
## [code]AgentData[/code] of the project's protobuf message. To be overridden.
func get_data(_observation_request, _storage) -> void:
	push_error("%s: override get_data(observation_request, storage)" % get_path())
