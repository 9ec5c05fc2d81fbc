class_name RLEnvWorld
extends Spatial
## The world around the agent of an [RLEnvironment], as in godot_gym_api.


## Lets the world stand still while nobody asks for a step; runs before a script's own.
func _ready() -> void:
	pause_mode = Node.PAUSE_MODE_STOP


## Begins an episode. To be overridden; whoever overrides [method RLEnvironment._reset] calls it.
func reset(_arguments = null) -> void:
	pass


## Takes what the client configures. May be overridden.
func configure(_world_config: Dictionary) -> void:
	pass


## Writes the state of the world into [param _storage]: a [Dictionary] where answers are JSON, else
## the [code]WorldData[/code] of the project's protobuf message. To be overridden.
func get_data(_observation_request, _storage) -> void:
	push_error("%s: override get_data(observation_request, storage)" % get_path())
