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

## The bytes of the request that is whole.
var payload: PoolByteArray
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


## Takes the connection.
func _init(stream: StreamPeerTCP) -> void:
	_stream = stream
	_stream.set_no_delay(true)


## Takes in what has come, without waiting; returns a [enum State].
func poll() -> int:
	var state := _next()
	while state == State.WAITING and not _has_ended:
		var num_bytes := _stream.get_available_bytes()
		if num_bytes <= 0:
			return _unfinished()
		_take(_stream.get_data(int(min(num_bytes, CHUNK_BYTES))))
		state = _next()
	return State.GONE if state == State.WAITING else state


## Sleeps until the client says or does something; not in the middle of a request, though, and not
## for a client that has never shown that it knows how to ask.
func block() -> void:
	if num_requests > 0 and _received.empty():
		_take(_stream.get_data(1))


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
			error = "a request of %d bytes, expected 1 to %d" % [length, MAX_BYTES]
			return State.BROKEN
		_num_bytes = HEADER_BYTES + length
	if _num_bytes == 0 or _received.size() < _num_bytes:
		return State.WAITING
	payload = _received.subarray(HEADER_BYTES, _num_bytes - 1)
	var has_more := _received.size() > _num_bytes
	_received = _received.subarray(_num_bytes, -1) if has_more else PoolByteArray()
	_began_ms = OS.get_ticks_msec()
	_num_bytes = 0
	num_requests += 1
	return State.WHOLE


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
