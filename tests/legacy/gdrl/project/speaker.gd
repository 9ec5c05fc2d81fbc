extends Node
## Speaks the wire of Godot RL Agents, as the game's side does: a stand-in for its sync node.
##
## A step lasts [member action_repeat] ticks. A reset is answered after one step, and another one
## passes before the game listens again.

var action_repeat := 4
var arguments := {}

var _stream := StreamPeerTCP.new()
var _agents: Array[Node] = []
var _num_ticks := 0
var _owes_step := false
var _owes_reset := false


func _ready() -> void:
	await get_parent().ready
	for argument: String in OS.get_cmdline_args():
		var parts := argument.trim_prefix("--").split("=")
		arguments[parts[0]] = parts[1] if parts.size() == 2 else ""
	action_repeat = int(arguments.get("action_repeat", action_repeat))
	seed(int(arguments.get("env_seed", 1)))
	Engine.physics_ticks_per_second = 60 * int(arguments.get("speedup", 1))
	Engine.time_scale = float(arguments.get("speedup", 1))
	_agents = get_tree().get_nodes_in_group("AGENT")
	_connect()


func _physics_process(_delta: float) -> void:
	_num_ticks += 1
	if (_num_ticks - 1) % action_repeat:
		return
	if _owes_reset:
		_owes_reset = false
		_say({"type": "reset", "obs": _of_all("get_obs"), "info": _of_all("get_info")})
		return
	if _owes_step:
		_owes_step = false
		_say_step()
	while _obey(_hear()):
		pass


func _connect() -> void:
	_stream.connect_to_host("127.0.0.1", int(arguments["port"]))
	while _stream.get_status() == StreamPeerTCP.STATUS_CONNECTING:
		OS.delay_msec(1)
		_stream.poll()
	_stream.set_no_delay(true)
	assert(_hear()["type"] == "handshake")
	assert(_hear()["type"] == "env_info")
	var names := _agents.map(func(agent: Node) -> String: return agent.get("policy_name"))
	var told := {"type": "env_info", "n_agents": _agents.size(), "agent_policy_names": names}
	told["observation_space"] = _of_all("get_obs_space")
	told["action_space"] = _of_all("get_action_space")
	_say(told)


## Returns whether another message comes before the next step.
func _obey(message: Dictionary) -> bool:
	match message.get("type"):
		"action":
			for index: int in _agents.size():
				_agents[index].call("set_action", message["action"][index])
			_owes_step = true
		"reset":
			for agent: Node in _agents:
				agent.set("needs_reset", true)
			_owes_reset = true
		"call":
			_say({"type": "call", "returns": _of_all(message["method"])})
			return true
		_:
			get_tree().quit()
	return false


func _say_step() -> void:
	var told := {"type": "step", "obs": _of_all("get_obs"), "info": _of_all("get_info")}
	told["reward"] = _of_all("get_reward")
	told["done"] = _of_all("get_done")
	_of_all("zero_reward")
	_of_all("set_done_false")
	_say(told)


func _of_all(method: String) -> Array:
	return _agents.map(func(agent: Node) -> Variant: return agent.call(method))


func _say(message: Dictionary) -> void:
	_stream.put_string(JSON.stringify(message, "", false))


func _hear() -> Dictionary:
	while _stream.get_available_bytes() == 0:
		_stream.poll()
		if _stream.get_status() != StreamPeerTCP.STATUS_CONNECTED:
			return {"type": "close"}
		OS.delay_usec(10)
	return JSON.parse_string(_stream.get_string())
