extends SceneTree
## A game that talks to a server as games for godot-ai do: points that should go to their goals.
##
## Arguments: port, rounds. Leaves the mean score of each round in scores.json.

const FOLDER := "AIServerCommFiles"
const NUM_SIMULATIONS := 40
const STEPS_IN_ROUND := 8
const TRAIN_STEPS := 80
const STEP_LENGTH := 0.25


## One game: a point and its goal.
class Simulation:
	extends RefCounted
	var position: Vector2
	var goal: Vector2

	func _init(rng: RandomNumberGenerator) -> void:
		position = Vector2(rng.randf_range(-1.0, 1.0), rng.randf_range(-1.0, 1.0))
		goal = Vector2(rng.randf_range(-1.0, 1.0), rng.randf_range(-1.0, 1.0))

	func get_state() -> Array[float]:
		return [position.x, position.y, goal.x, goal.y]

	## Moves; returns the score, how much nearer the goal is.
	func apply_action(action: Array[float]) -> float:
		var before := position.distance_to(goal)
		position += Vector2(action[0], action[1]) * STEP_LENGTH
		return 10.0 * (before - position.distance_to(goal))


var _peer := StreamPeerTCP.new()
var _rng := RandomNumberGenerator.new()


func _initialize() -> void:
	var arguments := OS.get_cmdline_user_args()
	_rng.seed = 1
	_connect(int(arguments[0]))
	_ask(
		{
			"command": "init",
			"file_name": "point",
			"state_dim": 4,
			"action_dim": 2,
			"batchsize": 128,
			"hidden_size": 48,
			"num_actor_layers": 1,
			"num_critic_layers": 1,
			"replay_capacity": 5000,
		}
	)
	_ask({"command": "load", "file_name": "point"})
	var scores: Array[float] = []
	for _round: int in int(arguments[1]):
		scores.append(_play_round(false))
		_ask(
			{
				"command": "train",
				"file_name": "point",
				"steps": TRAIN_STEPS,
				"print_logs": true,
				"checkpoint_name": "point",
			}
		)
	scores.append(_play_round(true))
	_ask({"command": "write_policy", "file_name": "point"})
	_write("scores.json", {"scores": scores})
	quit()


func _connect(port: int) -> void:
	var error := _peer.connect_to_host("127.0.0.1", port)
	assert(error == OK)
	while _peer.get_status() == StreamPeerTCP.STATUS_CONNECTING:
		_peer.poll()
		OS.delay_msec(1)


## Plays all simulations; returns the mean score of a step.
func _play_round(is_deterministic: bool) -> float:
	var simulations: Array[Simulation] = []
	for _i: int in NUM_SIMULATIONS:
		simulations.append(Simulation.new(_rng))
	var replays: Array[Dictionary] = []
	var total := 0.0
	for _step: int in STEPS_IN_ROUND:
		var actions := _get_actions(simulations, is_deterministic)
		for i: int in NUM_SIMULATIONS:
			var state := simulations[i].get_state()
			var action: Array[float] = [actions[2 * i], actions[2 * i + 1]]
			var score := simulations[i].apply_action(action)
			total += score
			(
				replays
				. append(
					{
						"state": state,
						"action": action,
						"reward": score,
						"state_": simulations[i].get_state(),
						"done": 0,
						"agent_name": "point",
					}
				)
			)
	_write("batch_replays.json", {"replays": replays})
	_ask({"command": "submit_batch_replay", "path": FOLDER + "/batch_replays.json"})
	return total / (NUM_SIMULATIONS * STEPS_IN_ROUND)


func _get_actions(simulations: Array[Simulation], is_deterministic: bool) -> Array:
	var states: Array[float] = []
	for simulation: Simulation in simulations:
		states.append_array(simulation.get_state())
	_write("batch_state.json", {"point": states})
	var message := {
		"command": "get_batch_actions",
		"deterministic_map": {"point": is_deterministic},
		"path": FOLDER + "/batch_state.json",
	}
	var path := str(_ask(message)["path"])
	var actions: Dictionary = JSON.parse_string(FileAccess.get_file_as_string("res://" + path))
	return actions["point"]


## Sends an object; collects bytes until they parse as one.
func _ask(message: Dictionary) -> Dictionary:
	_peer.put_data(JSON.stringify(message).to_utf8_buffer())
	var bytes: PackedByteArray = []
	var json := JSON.new()
	while _peer.get_status() == StreamPeerTCP.STATUS_CONNECTED:
		_peer.poll()
		if _peer.get_available_bytes() == 0:
			OS.delay_usec(100)
			continue
		var received: Array = _peer.get_data(_peer.get_available_bytes())
		var piece: PackedByteArray = received[1]
		bytes.append_array(piece)
		if json.parse(bytes.get_string_from_utf8()) == OK:
			var answer: Dictionary = json.data
			if answer.has("error"):
				printerr(answer["error"])
			return answer
	printerr("the server has gone")
	quit(1)
	return {}


func _write(name: String, values: Dictionary) -> void:
	var file := FileAccess.open("res://%s/%s" % [FOLDER, name], FileAccess.WRITE)
	file.store_string(JSON.stringify(values))
	file.close()
