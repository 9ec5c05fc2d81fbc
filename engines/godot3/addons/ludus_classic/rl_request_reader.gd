extends Reference
## Reads the requests of one client: a length (u32, little-endian) and as many bytes.

## What has come so far: nothing whole yet, a whole request, the end of the connection, or
## something that is no request.
enum State { WAITING, WHOLE, GONE, BROKEN }

const HEADER_BYTES := 4
const MAX_BYTES := 1 << 24
const CHUNK_BYTES := 1 << 16
## How long a request may take from its first byte to its last.
const TIMEOUT_MS := 5000

## The text of the request that is whole.
var text: String
## What is wrong with one that is broken.
var error: String = ""
## Number of whole requests so far.
var num_requests: int = 0

var _stream: StreamPeerTCP
var _received := PoolByteArray()
# Of the request that comes, with its length; 0 as long as that is not known.
var _num_bytes: int = 0
var _began_ms: int = 0
var _has_ended: bool = false
## Whether the last thing that came was the end of a request.
var _is_between: bool = false


## Takes the connection.
func _init(stream: StreamPeerTCP) -> void:
	_stream = stream
	_stream.set_no_delay(true)


## Takes in what has come, without waiting; returns a [enum State].
func poll() -> int:
	if _received.empty() and _num_bytes == 0:
		var num_bytes := _stream.get_available_bytes()
		if num_bytes > HEADER_BYTES:
			return _take_request(_stream.get_u8(), num_bytes - 1)
	return _poll_in_pieces()


## Sleeps until the client says or does something, and takes that in; not in the middle of a
## request, though, and not for a client that has never shown that it knows how to ask. Returns a
## [enum State].
func block() -> int:
	if not _is_between:
		return poll()
	var first := _stream.get_u8()
	# What a connection that has ended reads as, too.
	if first == 0 and _stream.get_status() != StreamPeerTCP.STATUS_CONNECTED:
		return State.GONE
	return _take_request(first, _stream.get_available_bytes())


## Reads a request behind its first byte. One that is there as a whole, as usual, is read without
## copies in GDScript, which take four times as long.
func _take_request(first: int, num_bytes: int) -> int:
	if num_bytes < HEADER_BYTES - 1:
		_is_between = false
		_began_ms = OS.get_ticks_msec()
		_received = PoolByteArray([first])
		return _poll_in_pieces()
	var length := first | _stream.get_u8() << 8 | _stream.get_u16() << 16
	if length == 0 or length > MAX_BYTES:
		return _refuse(length)
	if num_bytes - HEADER_BYTES + 1 < length:
		_is_between = false
		_began_ms = OS.get_ticks_msec()
		_received.resize(HEADER_BYTES)
		_num_bytes = HEADER_BYTES + length
		return _poll_in_pieces()
	text = _stream.get_utf8_string(length)
	_is_between = true
	num_requests += 1
	return State.WHOLE


func _poll_in_pieces() -> int:
	var state := _next()
	while state == State.WAITING and not _has_ended:
		var num_bytes := _stream.get_available_bytes()
		if num_bytes <= 0:
			return _unfinished()
		_take(_stream.get_data(int(min(num_bytes, CHUNK_BYTES))))
		state = _next()
	return State.GONE if state == State.WAITING else state


func _take(result: Array) -> void:
	_has_ended = result[0] != OK
	if _received.empty():
		_began_ms = OS.get_ticks_msec()
		_received = result[1]
	else:
		_received.append_array(result[1])


## Looks whether a request is whole. More may have come: a client need not wait for its answers.
func _next() -> int:
	if _num_bytes == 0 and _received.size() >= HEADER_BYTES:
		var length := _length()
		if length == 0 or length > MAX_BYTES:
			return _refuse(length)
		_num_bytes = HEADER_BYTES + length
	if _num_bytes == 0 or _received.size() < _num_bytes:
		return State.WAITING
	text = _received.subarray(HEADER_BYTES, _num_bytes - 1).get_string_from_utf8()
	var has_more := _received.size() > _num_bytes
	_received = _received.subarray(_num_bytes, -1) if has_more else PoolByteArray()
	_began_ms = OS.get_ticks_msec()
	_num_bytes = 0
	_is_between = not has_more
	num_requests += 1
	return State.WHOLE


func _refuse(length: int) -> int:
	error = "a request of %d bytes, expected 1 to %d" % [length, MAX_BYTES]
	return State.BROKEN


func _unfinished() -> int:
	if _stream.get_status() != StreamPeerTCP.STATUS_CONNECTED:
		return State.GONE
	if _received.empty() or OS.get_ticks_msec() - _began_ms <= TIMEOUT_MS:
		return State.WAITING
	var num_bytes := int(max(_num_bytes, HEADER_BYTES))
	error = (
		"a request did not come whole within %d s: %d of %d bytes"
		% [TIMEOUT_MS / 1000, _received.size(), num_bytes]
	)
	return State.BROKEN


func _length() -> int:
	return _received[0] | _received[1] << 8 | _received[2] << 16 | _received[3] << 24
