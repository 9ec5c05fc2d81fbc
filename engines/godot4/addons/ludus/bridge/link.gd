extends RefCounted
## A blocking connection to the trainer that carries whole frames.
##
## A read has no time limit of its own in Godot; a thread beside it tells the trainer and ends the
## process when the deadline has passed, or ends it when the process that started the game is gone.

const LudusArguments := preload("res://addons/ludus/bridge/arguments.gd")
const LudusGreeting := preload("res://addons/ludus/bridge/greeting.gd")
const LudusWire := preload("res://addons/ludus/bridge/wire.gd")

const MIN_TOKEN_LENGTH := 16
## How long a client of a listening game may take to prove itself.
const GREETING_TIMEOUT_MS := 10000
## With one more, the oldest is dropped: a trainer proves itself at once.
const MAX_PENDING := 64
const CONNECT_POLL_MS := 5
const WAIT_POLL_US := 300
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

## Type of the frame that [method receive] read.
var type: int = LudusWire.Type.NONE
## Payload of the frame that [method receive] read.
var payload: PackedByteArray
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

var _stream: StreamPeer
## Bytes that were here at the last look, and were not read since.
var _num_here: int = 0
## Header of the last frame that was allowed, as most that follow are.
var _header: PackedByteArray = []
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
func connect_to(addresses: PackedStringArray, timeout_ms: int) -> bool:
	for address: String in addresses:
		_stream = _open(address)
		if _stream != null and _await_connection(timeout_ms):
			is_local = address.begins_with("unix:") or is_loopback(address)
			return true
	error = "no trainer answers at %s" % ", ".join(addresses)
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
	var server := TCPServer.new()
	if server.listen(_port(address), _host(address)) != OK:
		error = "cannot listen at %s" % address
		return false
	var deadline := Time.get_ticks_msec() + timeout_ms
	var pending: Array[LudusGreeting] = []
	while _stream == null and error.is_empty():
		if Time.get_ticks_msec() > deadline:
			error = "no trainer connected to %s within %d s" % [address, timeout_ms / 1000]
		elif server.is_connection_available():
			var token := arguments.token_for(is_local)
			var peer := server.take_connection()
			pending.append(LudusGreeting.new(peer, hello.duplicate(), token, GREETING_TIMEOUT_MS))
			if pending.size() > MAX_PENDING:
				pending.pop_front().dismiss()
		else:
			OS.delay_msec(CONNECT_POLL_MS)
		pending = pending.filter(_is_still_pending)
	for greeting: LudusGreeting in pending:
		greeting.dismiss()
	server.stop()
	return error.is_empty()


## Greets a trainer with [param hello], and waits until it has proved that it knows
## [param token]. Returns how that went.
func greet(hello: Dictionary, token: String, timeout_ms: int) -> LudusGreeting:
	var greeting := LudusGreeting.new(_stream, hello, token, timeout_ms)
	while greeting.state == LudusGreeting.State.WAITING:
		OS.delay_usec(WAIT_POLL_US)
		greeting.advance()
	is_proven = greeting.state == LudusGreeting.State.PROVEN
	return greeting


## Starts the thread that enforces deadlines and, where the system shows processes as files, ends
## this process when [param parent_pid] is gone.
func watch(parent_pid: int) -> void:
	if parent_pid > 0 and DirAccess.dir_exists_absolute("/proc/%d" % parent_pid):
		_parent_path = "/proc/%d" % parent_pid
	if _watch == null:
		_watch = Thread.new()
		_watch.start(_enforce_deadlines)


## Sends a whole frame. Returns false if the connection has ended.
func send(frame: PackedByteArray) -> bool:
	return _stream.put_data(frame) == OK


## Waits until something has come, or the connection has ended, for at most [param timeout_ms]
## milliseconds. Returns whether that is so: then [method receive] does not wait for long.
func wait_for_data(timeout_ms: int) -> bool:
	_spin()
	var deadline := Time.get_ticks_msec() + timeout_ms
	while _stream.get_available_bytes() == 0:
		_stream.call(&"poll")
		if _stream.call(&"get_status") != StreamPeerTCP.STATUS_CONNECTED:
			return true
		if Time.get_ticks_msec() >= deadline:
			return false
		OS.delay_usec(WAIT_POLL_US)
	return true


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
	payload = PackedByteArray()
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
	if _stream != null and _stream.has_method(&"disconnect_from_host"):
		_stream.call(&"disconnect_from_host")
	_stream = null


func _open(address: String) -> StreamPeer:
	if address.begins_with("unix:"):
		return _open_unix(address.trim_prefix("unix:"))
	var stream := StreamPeerTCP.new()
	var host := _host(address)
	if stream.connect_to_host("127.0.0.1" if host == "localhost" else host, _port(address)) != OK:
		return null
	return stream


## Unix sockets came with Godot 4.6; older engines go on to the next address.
func _open_unix(path: String) -> StreamPeer:
	if not ClassDB.can_instantiate(&"StreamPeerUDS"):
		return null
	var stream: StreamPeer = ClassDB.instantiate(&"StreamPeerUDS")
	return stream if stream.call(&"connect_to_host", path) == OK else null


func _await_connection(timeout_ms: int) -> bool:
	var deadline := Time.get_ticks_msec() + timeout_ms
	while true:
		_stream.call(&"poll")
		var status: int = _stream.call(&"get_status")
		if status == StreamPeerTCP.STATUS_CONNECTED:
			if _stream is StreamPeerTCP:
				(_stream as StreamPeerTCP).set_no_delay(true)
			return true
		if status != StreamPeerTCP.STATUS_CONNECTING or Time.get_ticks_msec() > deadline:
			return false
		OS.delay_msec(CONNECT_POLL_MS)
	return false


## Reads type and length of the payload from a header. Returns whether it is allowed.
func _take_header(header: PackedByteArray) -> bool:
	type = header[4]
	_num_bytes = header.decode_u32(0)
	if _num_bytes > LudusWire.max_payload_bytes(type):
		error = "frame of type %d with %d bytes is not allowed" % [type, _num_bytes]
		return false
	if header[5] != 0 or header.decode_u16(6) != 0:
		error = "frame of type %d with flags is of another version" % type
		return false
	_header = header
	return true


func _spin() -> void:
	var now := Time.get_ticks_usec()
	if spin_us == 0 or now < _backoff_until_us:
		return
	var end := now + spin_us
	var was_away := false
	while now < end:
		_num_here = _stream.get_available_bytes()
		if _num_here > 0:
			break
		var before := now
		now = Time.get_ticks_usec()
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
		_backoff_us = clampi(longer, FIRST_BACKOFF_US, LONGEST_BACKOFF_US)
		_backoff_until_us = now + _backoff_us


## Reads what has come, or waits for it for at most [param timeout_ms] milliseconds.
func _read(num_bytes: int, timeout_ms: int) -> PackedByteArray:
	if _num_here < num_bytes:
		_num_here = _stream.get_available_bytes()
	var is_here := _num_here >= num_bytes
	_num_here = _num_here - num_bytes if is_here else 0
	if not is_here:
		_set_deadline(timeout_ms)
		if _watch == null:
			return _read_in_time(num_bytes)
	var result: Array = _stream.get_data(num_bytes)
	if not is_here:
		_set_deadline(0)
	return result[1] if result[0] == OK else PackedByteArray()


## Reads a header, for which the trainer has all its time until it begins.
func _read_header() -> PackedByteArray:
	if _num_here < LudusWire.HEADER_BYTES:
		_num_here = _stream.get_available_bytes()
	if _num_here >= LudusWire.HEADER_BYTES:
		return _read(LudusWire.HEADER_BYTES, 0)
	var header := _read(1, idle_timeout_ms)
	if not header.is_empty():
		header += _read(LudusWire.HEADER_BYTES - 1, FRAME_TIMEOUT_MS)
	return header


## Advances the greeting of a client. Returns whether it goes on.
func _is_still_pending(greeting: LudusGreeting) -> bool:
	greeting.advance()
	match greeting.state:
		LudusGreeting.State.WAITING:
			return true
		LudusGreeting.State.PROVEN:
			_take(greeting.stream)
		LudusGreeting.State.REFUSED:
			printerr("ludus: dropped a client: ", greeting.error)
			greeting.dismiss()
		LudusGreeting.State.ENDED:
			greeting.dismiss()
			if greeting.is_refusal_proven and _stream == null:
				error = "%s; %s" % [greeting.error, greeting.hint]
			elif not greeting.is_refusal_proven and not greeting.error.is_empty():
				var said := LudusGreeting.printable(greeting.error)
				printerr("ludus: dropped a client: ERROR without the trainer's proof: ", said)
	return false


func _take(stream: StreamPeer) -> void:
	if _stream == null:
		_stream = stream
		(stream as StreamPeerTCP).set_no_delay(true)
		is_proven = true


## Reads where no thread enforces deadlines: in a game that guides its training, which goes on
## without its trainer.
func _read_in_time(num_bytes: int) -> PackedByteArray:
	var bytes := PackedByteArray()
	while bytes.size() < num_bytes:
		var result: Array = _stream.get_partial_data(num_bytes - bytes.size())
		if result[0] != OK:
			return PackedByteArray()
		var piece: PackedByteArray = result[1]
		if not piece.is_empty():
			bytes += piece
		elif _deadline_ms > 0 and Time.get_ticks_msec() > _deadline_ms:
			error = "the rest of a frame did not come in time"
			return PackedByteArray()
		else:
			OS.delay_usec(WAIT_POLL_US)
	return bytes


func _set_deadline(timeout_ms: int) -> void:
	_mutex.lock()
	_deadline_ms = Time.get_ticks_msec() + timeout_ms if timeout_ms > 0 else 0
	_mutex.unlock()


func _enforce_deadlines() -> void:
	while true:
		OS.delay_msec(WATCH_INTERVAL_MS)
		_mutex.lock()
		var is_over := _deadline_ms > 0 and Time.get_ticks_msec() > _deadline_ms
		var is_closing := _is_closing
		_mutex.unlock()
		if is_closing:
			return
		if is_over:
			printerr("ludus: %s; the game quits" % SILENCE)
			# The other thread only reads. A trainer that takes nothing in is not waited for.
			var report := {"code": "timeout", "message": SILENCE, "hint": ""}
			_stream.put_partial_data(LudusWire.json_frame(LudusWire.Type.ERROR, report))
			OS.kill(OS.get_process_id())
		if not _parent_path.is_empty() and not DirAccess.dir_exists_absolute(_parent_path):
			OS.kill(OS.get_process_id())


static func _host(address: String) -> String:
	var rest := address.trim_prefix("tcp:")
	return rest.substr(0, rest.rfind(":")).trim_prefix("[").trim_suffix("]")


static func _port(address: String) -> int:
	return address.substr(address.rfind(":") + 1).to_int()


## Whether an address is this machine's own, and no other can reach it.
static func is_loopback(address: String) -> bool:
	var host := _host(address)
	var is_number := host.is_valid_ip_address() and not ":" in host
	return host == "localhost" or host == "::1" or (is_number and host.begins_with("127."))
