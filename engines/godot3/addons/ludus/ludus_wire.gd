class_name LudusWire
extends Reference
## The names and sizes of PROTOCOL.md, and the payloads that need no spec. No input or output.
##
## Arrays of bytes are put together with few calls, and of few kinds: between two steps the engine's
## own work drives all that from the caches, and to fetch the code of another kind costs more than
## the call.

## Frame types (PROTOCOL.md §1).
enum Type {
	NONE,
	HELLO,
	WELCOME,
	SPEC,
	RESET,
	STEP,
	BATCH,
	CALL,
	RESULT,
	PING,
	PONG,
	ERROR,
	CLOSE,
	CHALLENGE,
	PROOF,
}

## What a [code]RESET[/code] does to a world (PROTOCOL.md §5).
enum ResetAction {
	LEAVE,
	NEXT_EPISODE,
	SEED,
}

## A trainer of protocol 1 proves nothing, and is not taken.
const PROTOCOL_MIN := 2
const PROTOCOL_MAX := 2
const ADDON_VERSION := "0.1.0"
const CAPABILITIES := ["call", "ceiling", "rebuild", "requests", "reset_worlds"]
const HEADER_BYTES := 8
const MAX_PAYLOAD_BYTES := 268435456
const MAX_JSON_BYTES := 16777216
const MAX_PING_BYTES := 1048576
const MAX_GREETING_BYTES := 65536
const DEFAULT_PORT := 11011
const BATCH_HEAD_BYTES := 24
const FLAG_RESET := 1
const FLAG_REQUESTS := 2

## Largest payload of each type that a trainer may send.
const _MAX_PAYLOADS := {
	Type.WELCOME: MAX_JSON_BYTES,
	Type.RESET: MAX_PAYLOAD_BYTES,
	Type.STEP: MAX_PAYLOAD_BYTES,
	Type.CALL: MAX_JSON_BYTES,
	Type.PING: MAX_PING_BYTES,
	Type.ERROR: MAX_JSON_BYTES,
	Type.CLOSE: 0,
}
## Bytes that [code]var2bytes[/code] puts before the elements of a pool array: type and count.
const _VARIANT_HEAD_BYTES := 8
## So many numbers are read faster one by one.
const _FEW := 4


## Returns a whole [code]BATCH[/code] (PROTOCOL.md §7): its head, and [param body] behind it.
static func batch_frame(
	num_ticks: int, engine_us: int, bridge_us: int, wait_us: int, flags: int, body: PoolByteArray
) -> PoolByteArray:
	var words := [BATCH_HEAD_BYTES + body.size(), Type.BATCH, num_ticks, num_ticks >> 32]
	words.append_array([engine_us, bridge_us, wait_us, flags])
	var frame := int_bytes(PoolIntArray(words))
	frame.append_array(body)
	return frame


## Returns a whole frame with a JSON payload.
static func json_frame(type: int, value: Dictionary) -> PoolByteArray:
	return raw_frame(type, LudusJson.write(value).to_utf8())


## Returns a whole frame with the given payload.
static func raw_frame(type: int, payload: PoolByteArray) -> PoolByteArray:
	var frame := int_bytes(PoolIntArray([payload.size(), type]))
	frame.append_array(payload)
	return frame


## Largest payload a trainer may send in a frame of this type; -1 if it may not send the type.
static func max_payload_bytes(type: int) -> int:
	return _MAX_PAYLOADS.get(type, -1)


## Number of bytes with padding to a multiple of 8.
static func padded(num_bytes: int) -> int:
	return (num_bytes + 7) & ~7


## Returns bytes with zeros behind them up to a multiple of 8.
static func pad(bytes: PoolByteArray) -> PoolByteArray:
	if bytes.size() & 7:
		bytes.append_array(zeros(-bytes.size() & 7))
	return bytes


## Returns so many zeros.
static func zeros(num_bytes: int) -> PoolByteArray:
	var bytes := PoolByteArray()
	bytes.resize(num_bytes)
	bytes.fill(0)
	return bytes


## Wire bytes of float32 numbers.
static func float_bytes(numbers: PoolRealArray) -> PoolByteArray:
	if numbers.empty():
		return PoolByteArray()
	return var2bytes(numbers).subarray(_VARIANT_HEAD_BYTES, -1)


## Wire bytes of 32-bit whole numbers.
static func int_bytes(numbers: PoolIntArray) -> PoolByteArray:
	if numbers.empty():
		return PoolByteArray()
	return var2bytes(numbers).subarray(_VARIANT_HEAD_BYTES, -1)


## Wire bytes of 64-bit whole numbers.
static func long_bytes(numbers: Array) -> PoolByteArray:
	var buffer := StreamPeerBuffer.new()
	for number in numbers:
		buffer.put_64(number)
	return buffer.data_array


## Reads [param count] float32 numbers at [param offset].
static func read_floats(payload: PoolByteArray, offset: int, count: int) -> PoolRealArray:
	if count == 0:
		return PoolRealArray()
	return bytes2var(_variant(TYPE_REAL_ARRAY, payload, offset, count))


## Reads [param count] 64-bit whole numbers at [param offset] that fit into 31 bits, as choices do.
static func read_choices(payload: PoolByteArray, offset: int, count: int) -> Array:
	if count <= _FEW:
		var numbers := []
		for i in count:
			numbers.append(read_u32(payload, offset + 8 * i))
		return numbers
	var halves: PoolIntArray = bytes2var(_variant(TYPE_INT_ARRAY, payload, offset, 2 * count))
	return Array(halves).slice(0, 2 * count - 1, 2)


## Reads [param count] 64-bit whole numbers at [param offset].
static func read_longs(payload: PoolByteArray, offset: int, count: int) -> Array:
	var buffer := StreamPeerBuffer.new()
	buffer.data_array = payload
	buffer.seek(offset)
	var numbers := []
	for _i in count:
		numbers.append(buffer.get_64())
	return numbers


## Reads an unsigned 32-bit number at [param offset].
static func read_u32(bytes: PoolByteArray, offset: int) -> int:
	var low := bytes[offset] | bytes[offset + 1] << 8
	return low | bytes[offset + 2] << 16 | bytes[offset + 3] << 24


## Reads the JSON object of a payload; null if it is none.
static func read_json(payload: PoolByteArray):
	var json := JSON.parse(payload.get_string_from_utf8())
	if json.error != OK or not json.result is Dictionary:
		return null
	return json.result


## Reads a [code]RESET[/code] (PROTOCOL.md §5) for [param num_worlds] worlds: a dictionary of
## [code]seeds[/code], [code]actions[/code] and [code]parameters[/code]; empty if it is malformed.
static func read_reset(payload: PoolByteArray, num_worlds: int) -> Dictionary:
	var head := 8 + padded(num_worlds * 9)
	if payload.size() <= head or read_u32(payload, 0) != num_worlds or num_worlds == 0:
		return {}
	if payload.size() != head + read_u32(payload, 4):
		return {}
	var actions := Array(payload.subarray(8 + num_worlds * 8, 7 + num_worlds * 9))
	for action in actions:
		if action > ResetAction.SEED:
			return {}
	var json := JSON.parse(payload.subarray(head, -1).get_string_from_utf8())
	if json.error != OK or not _are_parameters(json.result, num_worlds):
		return {}
	var seeds := read_longs(payload, 8, num_worlds)
	return {"seeds": seeds, "actions": actions, "parameters": json.result}


## Writes a [code]RESET[/code]; the counterpart of [method read_reset], for tests of the format.
static func reset_frame(seeds: Array, actions: PoolByteArray, parameters) -> PoolByteArray:
	var text := LudusJson.write(parameters).to_utf8()
	var payload := int_bytes(PoolIntArray([seeds.size(), text.size()]))
	payload.append_array(long_bytes(seeds))
	payload.append_array(actions)
	payload = pad(payload)
	payload.append_array(text)
	return raw_frame(Type.RESET, payload)


static func _variant(type: int, payload: PoolByteArray, offset: int, count: int) -> PoolByteArray:
	var whole := PoolByteArray([type, 0, 0, 0, count, count >> 8, count >> 16, count >> 24])
	whole.append_array(payload.subarray(offset, offset + 4 * count - 1))
	return whole


static func _are_parameters(value, num_worlds: int) -> bool:
	if value == null or value is Dictionary:
		return true
	if not value is Array or value.size() != num_worlds:
		return false
	for item in value:
		if item != null and not item is Dictionary:
			return false
	return true
