class_name LudusLink
extends Reference
## A blocking connection to the trainer that carries whole frames.
##
## A read has no time limit of its own in Godot; a thread beside it tells the trainer and ends the
## process when the deadline has passed, or ends it when the process that started the game is gone.
## Godot 3 has no Unix sockets.

const MIN_TOKEN_LENGTH := 16
## How long a client of a listening game may take to prove itself.
const GREETING_TIMEOUT_MS := 10000
## With one more, the oldest is dropped: a trainer proves itself at once.
const MAX_PENDING := 64
const CONNECT_POLL_MS := 5
const GREETING_POLL_MS := 1
const WATCH_INTERVAL_MS := 100
const FRAME_TIMEOUT_MS := 30000
const SILENCE := "the trainer was silent for too long"
## Between one look and the next it takes so long only if the core was taken away meanwhile.
const AWAY_US := 1000
## So many misses within [constant MISSES_WITHIN_US] mean nothing: updates, other work.
const MAX_MISSES := 5
const MISSES_WITHIN_US := 100000
## How long nobody looks then; twice as long each time that the core is soon lost again.
const FIRST_BACKOFF_US := 100000
const LONGEST_BACKOFF_US := 1000000
const UNIX_PREFIX := "unix:"

## Type of the frame that [method receive] read.
var type: int = LudusWire.Type.NONE
## Payload of the frame that [method receive] read.
var payload: PoolByteArray
## Why the last call failed; empty if the other side simply closed.
var error: String = ""
## Milliseconds the trainer may stay silent between requests; 0: for ever.
var idle_timeout_ms: int = 0
## Microseconds for which [method receive] looks again and again before it sleeps. Waking up costs
## tens of microseconds and cold caches, where a core is free for looking.
var spin_us: int = 0
## Whether the other side is on this machine.
var is_local: bool = true
## Whether the other side has proved that it knows the token.
var is_proven: bool = false

var _stream: StreamPeerTCP
## Bytes that were here at the last look, and were not read since.
var _num_here: int = 0
## Header of the last frame: of an allowed one, as most that follow are.
var _header := PoolByteArray()
var _num_bytes: int = 0
var _watch: Thread
var _mutex := Mutex.new()
var _deadline_ms: int = 0
var _backoff_us: int = 0
var _backoff_until_us: int = 0
var _missing_since_us: int = 0
var _num_misses: int = 0
var _is_closing: bool = false
var _parent_path: String = ""


## Connects to the first of some addresses that answers within [param timeout_ms] milliseconds.
func connect_to(addresses: Array, timeout_ms: int) -> bool:
	for address in addresses:
		_stream = _open(address)
		if _stream != null and _await_connection(timeout_ms):
			is_local = is_loopback(address)
			return true
	error = "no trainer answers at %s" % PoolStringArray(addresses).join(", ")
	_stream = null
	return false


## Listens at the TCP address of [param arguments] until a trainer has proved itself; others are
## dropped. Each is greeted with [param hello].
func listen_at(arguments: LudusArguments, timeout_ms: int, hello: Dictionary) -> bool:
	var address := arguments.listen_at
	is_local = is_loopback(address)
	if not is_local and arguments.token.length() < MIN_TOKEN_LENGTH:
		error = "a game that other machines can reach needs a token of 16 characters"
		return false
	var server := TCP_Server.new()
	if server.listen(_port(address), _host(address)) != OK:
		error = "cannot listen at %s" % address
		return false
	var deadline := OS.get_ticks_msec() + timeout_ms
	var pending := []
	while _stream == null and error.empty():
		if OS.get_ticks_msec() > deadline:
			error = "no trainer connected to %s within %d s" % [address, timeout_ms / 1000]
		elif server.is_connection_available():
			var token := arguments.token_for(is_local)
			var peer := server.take_connection()
			pending.append(LudusGreeting.new(peer, hello.duplicate(), token, GREETING_TIMEOUT_MS))
			if pending.size() > MAX_PENDING:
				pending.pop_front().dismiss()
		else:
			OS.delay_msec(CONNECT_POLL_MS)
		pending = _move_on(pending)
	for greeting in pending:
		greeting.dismiss()
	server.stop()
	return error.empty()


## Greets a trainer with [param hello], and waits until it has proved that it knows
## [param token]. Returns how that went.
func greet(hello: Dictionary, token: String, timeout_ms: int) -> LudusGreeting:
	var greeting := LudusGreeting.new(_stream, hello, token, timeout_ms)
	while greeting.state == LudusGreeting.State.WAITING:
		OS.delay_msec(GREETING_POLL_MS)
		greeting.advance()
	is_proven = greeting.state == LudusGreeting.State.PROVEN
	return greeting


## Starts the thread that enforces deadlines and, where the system shows processes as files, ends
## this process when [param parent_pid] is gone.
func watch(parent_pid: int) -> void:
	var path := "/proc/%d/status" % parent_pid
	if parent_pid > 0 and File.new().file_exists(path):
		_parent_path = path
	if _watch != null:
		return
	_watch = Thread.new()
	if _watch.start(self, "_enforce_deadlines") != OK:
		push_error("ludus: no thread for deadlines")
		_watch = null


## Sends a whole frame. Returns false if the connection has ended.
func send(frame: PoolByteArray) -> bool:
	return _stream.put_data(frame) == OK


## Reads one frame into [member type] and [member payload]. Returns false if the connection has
## ended or the frame is not allowed.
func receive() -> bool:
	error = ""
	_spin()
	var header := _read_header()
	if header.size() < LudusWire.HEADER_BYTES:
		return false
	if header != _header and not _take_header(header):
		return false
	payload = PoolByteArray()
	if _num_bytes > 0:
		payload = _read(_num_bytes, FRAME_TIMEOUT_MS)
	return payload.size() == _num_bytes


## Closes the connection and ends the thread.
func close() -> void:
	_mutex.lock()
	_is_closing = true
	_mutex.unlock()
	if _watch != null:
		_watch.wait_to_finish()
		_watch = null
	if _stream != null:
		_stream.disconnect_from_host()
	_stream = null


func _open(address: String) -> StreamPeerTCP:
	if address.begins_with(UNIX_PREFIX):
		return null
	var stream := StreamPeerTCP.new()
	var host := _host(address)
	if stream.connect_to_host("127.0.0.1" if host == "localhost" else host, _port(address)) != OK:
		return null
	return stream


func _await_connection(timeout_ms: int) -> bool:
	var deadline := OS.get_ticks_msec() + timeout_ms
	while true:
		var status := _stream.get_status()
		if status == StreamPeerTCP.STATUS_CONNECTED:
			_stream.set_no_delay(true)
			return true
		if status != StreamPeerTCP.STATUS_CONNECTING or OS.get_ticks_msec() > deadline:
			return false
		OS.delay_msec(CONNECT_POLL_MS)
	return false


## Reads type and length of the payload from a header. Returns whether it is allowed.
func _take_header(header: PoolByteArray) -> bool:
	type = header[4]
	_num_bytes = LudusWire.read_u32(header, 0)
	if _num_bytes > LudusWire.max_payload_bytes(type):
		error = "frame of type %d with %d bytes is not allowed" % [type, _num_bytes]
		return false
	if header[5] != 0 or header[6] != 0 or header[7] != 0:
		error = "frame of type %d with flags is of another version" % type
		return false
	_header = header
	return true


func _spin() -> void:
	var now := OS.get_ticks_usec()
	if spin_us == 0 or now < _backoff_until_us:
		return
	var end := now + spin_us
	var was_away := false
	while now < end:
		_num_here = _stream.get_available_bytes()
		if _num_here > 0:
			break
		var before := now
		now = OS.get_ticks_usec()
		if now - before > AWAY_US:
			was_away = true
	if was_away or now >= end:
		_record_miss(now)


## Leaves the core alone for a while if looks often find nothing, or lose the core meanwhile:
## somebody else needs it, perhaps the very process that is waited for.
func _record_miss(now: int) -> void:
	if now - _missing_since_us > MISSES_WITHIN_US:
		_missing_since_us = now
		_num_misses = 0
	_num_misses += 1
	if _num_misses > MAX_MISSES:
		var is_soon := now - _backoff_until_us < LONGEST_BACKOFF_US
		var longer := 2 * _backoff_us if is_soon else 0
		_backoff_us = int(clamp(longer, FIRST_BACKOFF_US, LONGEST_BACKOFF_US))
		_backoff_until_us = now + _backoff_us


## Reads a header, for which the trainer has all its time until it begins.
func _read_header() -> PoolByteArray:
	if _num_here < LudusWire.HEADER_BYTES:
		_num_here = _stream.get_available_bytes()
	if _num_here >= LudusWire.HEADER_BYTES:
		return _read(LudusWire.HEADER_BYTES, 0)
	var header := _read(1, idle_timeout_ms)
	if not header.empty():
		header.append_array(_read(LudusWire.HEADER_BYTES - 1, FRAME_TIMEOUT_MS))
	return header


## Advances the greetings of clients. Returns those that go on.
func _move_on(pending: Array) -> Array:
	var staying := []
	for greeting in pending:
		greeting.advance()
		match greeting.state:
			LudusGreeting.State.WAITING:
				staying.append(greeting)
			LudusGreeting.State.PROVEN:
				_take(greeting.stream)
			LudusGreeting.State.REFUSED:
				printerr("ludus: dropped a client: ", greeting.error)
				greeting.dismiss()
			LudusGreeting.State.ENDED:
				greeting.dismiss()
				if greeting.is_refusal_proven and _stream == null:
					error = "%s; %s" % [greeting.error, greeting.hint]
				elif not greeting.is_refusal_proven and not greeting.error.empty():
					var said := LudusGreeting.printable(greeting.error)
					printerr("ludus: dropped a client: ERROR without the trainer's proof: ", said)
	return staying


func _take(stream: StreamPeerTCP) -> void:
	if _stream == null:
		_stream = stream
		_stream.set_no_delay(true)
		is_proven = true


func _read(num_bytes: int, timeout_ms: int) -> PoolByteArray:
	if _num_here < num_bytes:
		_num_here = _stream.get_available_bytes()
	var is_here := _num_here >= num_bytes
	if not is_here:
		_set_deadline(timeout_ms)
	var result := _stream.get_data(num_bytes)
	if not is_here:
		_set_deadline(0)
	_num_here = _num_here - num_bytes if is_here else 0
	return result[1] if result[0] == OK else PoolByteArray()


func _set_deadline(timeout_ms: int) -> void:
	_mutex.lock()
	_deadline_ms = OS.get_ticks_msec() + timeout_ms if timeout_ms > 0 else 0
	_mutex.unlock()


func _enforce_deadlines(_data = null) -> void:
	# Not Directory: that changes the working folder of the process for a moment.
	var file := File.new()
	while true:
		OS.delay_msec(WATCH_INTERVAL_MS)
		_mutex.lock()
		var is_over := _deadline_ms > 0 and OS.get_ticks_msec() > _deadline_ms
		var is_closing := _is_closing
		_mutex.unlock()
		if is_closing:
			return
		if is_over:
			printerr("ludus: %s; the game quits" % SILENCE)
			# The other thread only reads. A trainer that takes nothing in is not waited for.
			var report := {"code": "timeout", "message": SILENCE, "hint": ""}
			var _sent := _stream.put_partial_data(
				LudusWire.json_frame(LudusWire.Type.ERROR, report)
			)
			_die()
		if not _parent_path.empty() and not file.file_exists(_parent_path):
			_die()


static func _die() -> void:
	if OS.kill(OS.get_process_id()) != OK:
		OS.crash("ludus: the trainer is gone")


static func _host(address: String) -> String:
	var rest := address.trim_prefix("tcp:")
	return rest.substr(0, rest.find_last(":")).trim_prefix("[").trim_suffix("]")


static func _port(address: String) -> int:
	return int(address.substr(address.find_last(":") + 1))


## Whether an address is this machine's own, and no other can reach it.
static func is_loopback(address: String) -> bool:
	var host := _host(address)
	var is_number := host.is_valid_ip_address() and not ":" in host
	return host == "localhost" or host == "::1" or (is_number and host.begins_with("127."))
