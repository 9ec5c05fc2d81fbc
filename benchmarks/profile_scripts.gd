extends SceneTree
## Godot's own profiler, without the editor: which functions of a game's scripts take its time.
##
##     godot --headless --script benchmarks/profile_scripts.gd -- PORT SECONDS
##
## waits for a game that is started with `--remote-debug tcp://127.0.0.1:PORT`, lets it play for
## `WARM_UP_S`, and prints where the time of its frames went in the seconds after that. Functions
## of the engine that scripts call count by themselves. Profiling slows scripts down: the shares
## say what to look at.

const MAIN_THREAD := 1
const START_TIMEOUT_S := 60
const WARM_UP_S := 4
const MAX_PACKET_BYTES := 1 << 23
const MAX_FUNCTIONS := 512
const NUM_SHOWN := 20
## Places in a message of the profiler.
const FRAME_TIME := 1
const SCRIPT_TIME := 5
const SERVERS := 6
## What it says of a function: id, calls, time without and with what it calls, time inside it.
const NUM_FIELDS := 5

var _seconds: int
var _server := TCPServer.new()
var _game: PacketPeerStream
var _begins_ms: int
var _num_frames := 0
var _frame_s := 0.0
var _script_s := 0.0
var _names := {}
var _own_s := {}
var _num_calls := {}


func _initialize() -> void:
	var arguments := OS.get_cmdline_user_args()
	if arguments.size() != 2 or _server.listen(int(arguments[0]), "127.0.0.1") != OK:
		printerr("expected a free port and a number of seconds after --")
		quit(2)
		return
	_seconds = int(arguments[1])


func _process(_delta: float) -> bool:
	if _game == null:
		if _server.is_connection_available():
			_begin()
		elif Time.get_ticks_msec() > 1000 * START_TIMEOUT_S:
			printerr("no game connected within %d s" % START_TIMEOUT_S)
			quit(1)
		return false
	(_game.stream_peer as StreamPeerTCP).poll()
	while _game.get_available_packet_count() > 0:
		var message: Array = _game.get_var()
		_take(message[0], message[2])
	if Time.get_ticks_msec() < _begins_ms + 1000 * _seconds:
		return false
	_report()
	return true


func _begin() -> void:
	_game = PacketPeerStream.new()
	_game.input_buffer_max_size = MAX_PACKET_BYTES
	_game.stream_peer = _server.take_connection()
	_game.put_var(["profiler:servers", MAIN_THREAD, [true, [MAX_FUNCTIONS, true]]])
	_begins_ms = Time.get_ticks_msec() + 1000 * WARM_UP_S


func _take(what: String, data: Array) -> void:
	if what == "servers:function_signature":
		_names[data[1]] = data[0]
	elif what == "servers:profile_frame" and Time.get_ticks_msec() >= _begins_ms:
		_add_frame(data)


func _add_frame(data: Array) -> void:
	_num_frames += 1
	_frame_s += data[FRAME_TIME]
	_script_s += data[SCRIPT_TIME]
	var at := SERVERS + 1
	for _server_index: int in data[SERVERS]:
		at += 2 + int(data[at + 1])
	var end := at + 1 + int(data[at])
	at += 1
	while at < end:
		var id: int = data[at]
		_num_calls[id] = _num_calls.get(id, 0) + data[at + 1]
		_own_s[id] = _own_s.get(id, 0.0) + data[at + 2]
		at += NUM_FIELDS


func _report() -> void:
	if _num_frames == 0:
		printerr("the game sent no frames")
		return
	var shares := [_num_frames, 1000.0 * _frame_s / _num_frames, 100.0 * _script_s / _frame_s]
	print("%d frames of %.2f ms; scripts take %.0f %%" % shares)
	var ids := _own_s.keys()
	ids.sort_custom(func(a: int, b: int) -> bool: return _own_s[a] > _own_s[b])
	for id: int in ids.slice(0, NUM_SHOWN):
		var calls := float(_num_calls[id]) / _num_frames
		var share: float = 100.0 * _own_s[id] / _frame_s
		print("%5.1f %%  %7.1f calls a frame  %s" % [share, calls, _names.get(id, "?")])
