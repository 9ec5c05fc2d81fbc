class_name Communication
extends Reference
## The game's end of the wire of godot_gym_api: a TCP server for one client at a time.
##
## A request is a length (u32, little-endian) and a JSON object; an answer is a length and a
## protobuf message or a JSON object. Whoever sends something else is sent away, and the next client
## is served.

## Emitted for each request, with its content.
signal got_connection(request)
## Emitted when the client has gone, or was sent away.
signal lost_connection

const DEFAULT_PORT := 9090
const DEFAULT_ADDRESS := "127.0.0.1"

const Request := preload("rl_request.gd")
const RequestReader := preload("rl_request_reader.gd")
const JsonWriter := preload("rl_json.gd")

const WAITING := RequestReader.State.WAITING
const WHOLE := RequestReader.State.WHOLE

## Argument by which whoever starts the game chooses another port.
const PORT_ARGUMENT := "--ludus-port="
## A game without a client sleeps this long in each frame.
const IDLE_MS := 5
## Requests between two looks for another client that waits.
const LOOK_EVERY_REQUESTS := 16
## Waiting longer than this for a request lets a frame pass, so that the window stays alive.
const WINDOW_WAIT_MS := 8
## The same without a window.
const SERVER_WAIT_MS := 100
## How long to sleep before one looks again.
const POLL_US := 50
## How long an answer may take to send.
const SEND_TIMEOUT_MS := 5000
## In a request it is looked after every so many frames whether its client is still there.
const CHECK_EVERY_FRAMES := 60

## The listening socket.
var server := TCP_Server.new()
## The client that is served; null if there is none.
var connection: StreamPeerTCP = null
## Whether a request waits for its answer.
var message_processing: bool = false
## Number of the request that is answered now; it changes when that request's client is gone.
var request_number: int = 0
## Whether [method start_server] may listen at an address that other machines reach. The wire has
## no password: whoever reaches the port can play the game.
var allow_remote: bool = false
## Whether the main loop may stand still until the client asks something. That is fastest, but a
## window would be dead meanwhile; Godot's server has none.
var can_block: bool = OS.has_feature("Server")

var _reader: RequestReader
var _request := Request.new()
## The last answer's length, and the bytes that say it: most answers have the same.
var _header_value: int = 0
var _header := PoolByteArray([0, 0, 0, 0])
## Frames since the request came that is answered now.
var _num_frames: int = 0
var _has_told_of_another: bool = false


## Begins to listen. The command line [code]--ludus-port=N[/code] overrides [param port].
func start_server(port: int = DEFAULT_PORT, address: String = DEFAULT_ADDRESS) -> void:
	port = _port_of_command_line(port)
	if not allow_remote and not _is_loopback(address):
		var what := "start_server: %s lets other machines connect" % address
		push_error("%s; set communication.allow_remote first if you want that" % what)
		return
	var error := server.listen(port, address)
	if error != OK:
		push_error("cannot listen at %s, port %d (error %d): is it taken?" % [address, port, error])
		return
	print("Listen on address: ", address, ", port: ", port)


## Serves the client, or waits for one; called in every frame. Waits for the next request, though
## not longer than a window bears.
func server_poll() -> void:
	if message_processing:
		_num_frames += 1
		if _num_frames % CHECK_EVERY_FRAMES == 0:
			check_client()
		return
	if connection == null:
		_take_connection()
	elif _reader.num_requests % LOOK_EVERY_REQUESTS == 0 and _should_change_client():
		_take_connection()
	if connection == null:
		OS.delay_msec(IDLE_MS)
	else:
		_await_request()


## Answers with a message as godobuf makes them: anything with a method [code]to_bytes()[/code].
func put_message(message) -> void:
	put_bytes(message.to_bytes())


## Answers with a value of dictionaries, arrays, numbers and texts as JSON.
func put_json(value) -> void:
	put_bytes(JsonWriter.write(value).to_utf8())


## Answers with these bytes. Nothing happens if the client has gone.
func put_bytes(bytes: PoolByteArray) -> void:
	if connection == null:
		return
	message_processing = false
	var num_bytes := bytes.size()
	if num_bytes != _header_value:
		_header_value = num_bytes
		_header = PoolByteArray(
			[num_bytes & 255, num_bytes >> 8 & 255, num_bytes >> 16 & 255, num_bytes >> 24 & 255]
		)
	var frame := _header
	frame.append_array(bytes)
	var result := connection.put_partial_data(frame)
	if result[0] != OK:
		_lose_client()
	elif result[1] < frame.size():
		_put_patiently(frame.subarray(result[1], -1))


## Ends a request that gets no answer.
func skip_answer() -> void:
	message_processing = false


## Ends the connection with the client, and says why.
func send_away(reason: String) -> void:
	printerr("ERROR: the client was sent away: %s" % reason)
	_leave_client()


## Leaves the client if it has gone; may be called while its request is worked on.
func check_client() -> void:
	if connection != null and connection.get_status() != StreamPeerTCP.STATUS_CONNECTED:
		_lose_client()


func _put_patiently(rest: PoolByteArray) -> void:
	var deadline := OS.get_ticks_msec() + SEND_TIMEOUT_MS
	while not rest.empty():
		if OS.get_ticks_msec() > deadline:
			send_away("it does not read its answer: %d bytes are left" % rest.size())
			return
		OS.delay_usec(POLL_US)
		var result := connection.put_partial_data(rest)
		if result[0] != OK:
			_lose_client()
			return
		rest = rest.subarray(result[1], -1) if result[1] < rest.size() else PoolByteArray()


func _take_connection() -> void:
	if not server.is_connection_available():
		return
	connection = server.take_connection()
	_reader = RequestReader.new(connection)
	_has_told_of_another = false
	print("\nConnection is taken.\n")


## A client that has never asked anything must not keep others out.
func _should_change_client() -> bool:
	if not server.is_connection_available():
		return false
	if _reader.num_requests == 0:
		send_away("it has asked nothing, and another one waits")
		return true
	if not _has_told_of_another:
		_has_told_of_another = true
		print("Another client waits until this one has gone.")
	return false


func _await_request() -> void:
	var state := _reader.block() if can_block else _reader.poll()
	if state == WAITING:
		state = _poll_for_a_while()
	if state == WHOLE:
		_handle_request()
	elif state == RequestReader.State.GONE:
		_lose_client()
	elif state == RequestReader.State.BROKEN:
		send_away(_reader.error)


func _poll_for_a_while() -> int:
	var wait_ms := SERVER_WAIT_MS if can_block else WINDOW_WAIT_MS
	var deadline := OS.get_ticks_msec() + wait_ms
	var state := WAITING
	while state == WAITING and OS.get_ticks_msec() < deadline:
		OS.delay_usec(POLL_US)
		state = _reader.poll()
	return state


func _handle_request() -> void:
	_request.read(_reader.text)
	if not _request.error.empty():
		send_away(_request.error)
		return
	if not _request.unknown_keys.empty():
		printerr("WARNING: the request has unknown keys: %s" % [_request.unknown_keys])
	message_processing = true
	request_number += 1
	_num_frames = 0
	emit_signal("got_connection", _request.content)


func _lose_client() -> void:
	print("\nConnection is lost!\n")
	_leave_client()


func _leave_client() -> void:
	connection.disconnect_from_host()
	connection = null
	_reader = null
	message_processing = false
	request_number += 1
	emit_signal("lost_connection")


static func _port_of_command_line(port: int) -> int:
	for argument in OS.get_cmdline_args():
		if argument.begins_with(PORT_ARGUMENT):
			return int(argument.trim_prefix(PORT_ARGUMENT))
	return port


static func _is_loopback(address: String) -> bool:
	return address == "localhost" or address == "::1" or address.begins_with("127.")
