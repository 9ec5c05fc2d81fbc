extends Node
## GymGodot's own wire, for a game that its Python or Ludus's [code]server-v0[/code] starts.
##
## It connects to Python by WebSocket, lets the game run for a step, and pauses it in between. A
## child of [LudusGymGodot], whose settings it reads.

const WANTED_BY := ["--serverIP", "--serverPort"]

## Node with GymGodot's five methods.
var environment: Node
## Frames of a step.
var step_length: int = 2
## Print what Python asks for.
var is_logging: bool = false

var _client := WebSocketClient.new()
var _arguments := {"serverIP": "127.0.0.1", "serverPort": "8000", "renderPath": "./render_frames/"}
var _action: Array = []
var _num_frames: int = 0
var _num_pictures: int = 0


## Whether this process was started as GymGodot's Python starts games, and not by Ludus.
static func is_wanted() -> bool:
	if LudusArguments.new().has_trainer():
		return false
	for argument in OS.get_cmdline_args():
		if argument.split("=")[0] in WANTED_BY:
			return true
	return false


func _ready() -> void:
	pause_mode = Node.PAUSE_MODE_PROCESS
	get_tree().paused = true
	for argument in OS.get_cmdline_args():
		var name: String = argument.split("=")[0].trim_prefix("--")
		if name in _arguments:
			_arguments[name] = argument.substr(argument.find("=") + 1)
	var error := _client.connect("data_received", self, "_answer")
	error += _client.connect("connection_established", self, "_write_text")
	error += _client.connect_to_url("ws://%s:%s" % [_arguments.serverIP, _arguments.serverPort])
	if error != OK:
		_quit()


func _process(_delta: float) -> void:
	if _client.get_connection_status() == NetworkedMultiplayerPeer.CONNECTION_DISCONNECTED:
		_quit()
	else:
		_client.poll()


func _physics_process(_delta: float) -> void:
	if _num_frames >= step_length:
		get_tree().paused = true
		_num_frames = 0
		_answer_step()
	elif not get_tree().paused:
		_num_frames += 1
		environment.apply_action(_action)


func _exit_tree() -> void:
	_client.disconnect_from_host()


func _write_text(_protocol: String) -> void:
	_client.get_peer(1).set_write_mode(WebSocketPeer.WRITE_MODE_TEXT)


func _answer() -> void:
	var text: String = _client.get_peer(1).get_packet().get_string_from_utf8()
	var request = JSON.parse(text).result
	if is_logging:
		print("GYMGODOT : %s" % text)
	match request.get("cmd") if request is Dictionary else null:
		"reset":
			environment.reset()
			_send({"init_observation": environment.get_observation()})
			_num_pictures = 0
		"step":
			_action = request["action"]
			get_tree().paused = false
		"render":
			_answer_render()
		"close":
			_client.disconnect_from_host()
			get_tree().quit()
		_:
			push_error("GYMGODOT : unknown request %s" % text)


func _answer_step() -> void:
	var observation: Array = environment.get_observation()
	var reward: float = environment.get_reward()
	_send({"observation": observation, "reward": reward, "done": environment.is_done()})


func _answer_render() -> void:
	VisualServer.force_draw()
	var picture: Image = get_viewport().get_texture().get_data()
	picture.flip_y()
	var error := picture.save_png("%s%d.png" % [_arguments.renderPath, _num_pictures])
	_num_pictures += 1
	_send({"render_error": str(error)})


func _send(answer: Dictionary) -> void:
	var error := _client.get_peer(1).put_packet(JSON.print(answer).to_utf8())
	if error != OK:
		push_error("GYMGODOT : an answer cannot be sent (error %d)" % error)
		_quit()


func _quit() -> void:
	print("GYMGODOT : Server connection lost, exit")
	get_tree().quit()
