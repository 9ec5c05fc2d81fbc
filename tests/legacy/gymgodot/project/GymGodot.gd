# The names in camelCase are GymGodot's.
# gdlint: disable=class-variable-name
extends Node
## The game's side of GymGodot's wire, written anew from its description: connects to Python, lets
## the game run for [member stepLength] frames a step, and pauses it between steps.

## Whether Python plays; else the scene runs on its own.
export var enabled: bool = true
## Frames of a step; the action is applied in each of them.
export var stepLength: int = 2
## Node with the five methods.
export var environmentNode: NodePath
## Print what Python asks for.
export var debugPrint: bool = false

var _client := WebSocketClient.new()
var _arguments: Dictionary = {"serverIP": "127.0.0.1", "serverPort": "8000", "renderPath": "./"}
var _action: Array = []
var _num_frames: int = 0
var _num_pictures: int = 0

onready var _environment: Node = get_node(environmentNode)


func _ready() -> void:
	set_process(enabled)
	set_physics_process(enabled)
	if not enabled:
		return
	pause_mode = Node.PAUSE_MODE_PROCESS
	get_tree().paused = true
	_read_arguments()
	var error := _client.connect("data_received", self, "_on_data")
	error += _client.connect("connection_established", self, "_on_connection")
	error += _client.connect_to_url("ws://%s:%s" % [_arguments.serverIP, _arguments.serverPort])
	if error != OK:
		_quit()


func _process(_delta: float) -> void:
	if _client.get_connection_status() == NetworkedMultiplayerPeer.CONNECTION_DISCONNECTED:
		_quit()
	else:
		_client.poll()


func _physics_process(_delta: float) -> void:
	if _num_frames == stepLength:
		get_tree().paused = true
		_num_frames = 0
		_answer_step()
	elif not get_tree().paused:
		_num_frames += 1
		_environment.apply_action(_action)


func _read_arguments() -> void:
	for argument in OS.get_cmdline_args():
		var parts: PoolStringArray = argument.trim_prefix("--").split("=")
		if parts.size() == 2:
			_arguments[parts[0]] = parts[1]


func _on_connection(_protocol: String) -> void:
	_client.get_peer(1).set_write_mode(WebSocketPeer.WRITE_MODE_TEXT)


func _on_data() -> void:
	var request: Dictionary = parse_json(_client.get_peer(1).get_packet().get_string_from_utf8())
	if debugPrint:
		print("GYMGODOT : %s" % request)
	match request.cmd:
		"reset":
			_environment.reset()
			_num_pictures = 0
			_send({"init_observation": _environment.get_observation()})
		"step":
			_action = request.action
			get_tree().paused = false
		"render":
			_answer_render()
		"close":
			_client.disconnect_from_host()
			get_tree().quit()


func _answer_step() -> void:
	var observation: Array = _environment.get_observation()
	var reward: float = _environment.get_reward()
	_send({"observation": observation, "reward": reward, "done": _environment.is_done()})


func _answer_render() -> void:
	VisualServer.force_draw()
	var picture: Image = get_viewport().get_texture().get_data()
	picture.flip_y()
	var error := picture.save_png("%s%d.png" % [_arguments.renderPath, _num_pictures])
	_num_pictures += 1
	_send({"render_error": str(error)})


func _send(answer: Dictionary) -> void:
	if _client.get_peer(1).put_packet(JSON.print(answer).to_utf8()) != OK:
		_quit()


func _quit() -> void:
	print("GYMGODOT : Server connection lost, exit")
	get_tree().quit()
