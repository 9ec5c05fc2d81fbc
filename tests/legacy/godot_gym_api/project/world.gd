extends RLEnvWorld
## Counts what happens around the agent. Its body moves at one metre a second.

var start: float = 0.0
var num_frames: int = 0
var num_steps: int = 0
var num_answers: int = 0
var seconds: float = 0.0

onready var body: RigidBody = $Body


func _physics_process(delta: float) -> void:
	num_frames += 1
	seconds += delta


func reset(_arguments = null) -> void:
	num_frames = 0
	num_steps = 0
	seconds = 0.0
	body.linear_velocity = Vector3.UP
	body.translation = Vector3.ZERO


func configure(world_config: Dictionary) -> void:
	start = world_config.get("start", start)


func get_data(observation_request, storage) -> void:
	if storage is Dictionary:
		storage["frames"] = num_frames
		storage["steps"] = num_steps
		storage["answers"] = num_answers
		storage["seconds"] = seconds
		storage["height"] = body.translation.y
		if "idle_frames" in observation_request:
			storage["idle_frames"] = get_parent().num_idle_frames
	else:
		storage.set_is_far(get_parent().agent.place > 3.0)
