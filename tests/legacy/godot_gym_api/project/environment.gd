extends RLEnvironment
## A point on a line. The environment variable WALK_FAULT names what goes wrong in the third step;
## WALK_ADDRESS the address to listen at.

var num_answers: int = 0
var num_own_steps: int = 0
var num_idle_frames: int = 0


func _ready() -> void:
	world = $World
	agent = $Agent
	if OS.get_environment("WALK_FAULT") == "no_agent":
		agent = null
	var address := OS.get_environment("WALK_ADDRESS")
	communication.can_block = OS.get_environment("WALK_BLOCKS") != "no"
	communication.start_server(9090, "127.0.0.1" if address.empty() else address)


func _process(_delta: float) -> void:
	num_idle_frames += 1


func _reset() -> void:
	world.reset()
	agent.reset(world.start)


func _step(action):
	num_own_steps += 1
	yield(._step(action), "completed")
	world.num_steps += 1


func _after_send_response() -> void:
	num_answers += 1
	world.num_answers = num_answers
