extends RefCounted
## The names and sizes of PROTOCOL.md, and the payloads that need no spec. No input or output.

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

## This script: a type without it is first the game's global class of that name.
const LudusWire := preload("res://addons/ludus/bridge/wire.gd")
## A trainer of protocol 1 proves nothing, and is not taken.
const PROTOCOL_MIN := 2
const PROTOCOL_MAX := 2
const ADDON_VERSION := "0.1.0"
const CAPABILITIES: PackedStringArray = [
	"call", "ceiling", "guided", "metrics", "rebuild", "requests", "reset_worlds"
]
const HEADER_BYTES := 8
const MAX_PAYLOAD_BYTES := 268435456
const MAX_JSON_BYTES := 16777216
const MAX_PING_BYTES := 1048576
const MAX_GREETING_BYTES := 65536
const DEFAULT_PORT := 11011
const BATCH_HEAD_BYTES := 24
const FLAG_RESET := 1
const FLAG_REQUESTS := 2


## Returns an empty frame of the given type, to append a payload to; see [method finish].
static func begin(type: LudusWire.Type) -> PackedByteArray:
	var frame := PackedByteArray()
	frame.resize(HEADER_BYTES)
	frame[4] = type
	return frame


## Writes the length of the payload into a frame's header.
static func finish(frame: PackedByteArray) -> PackedByteArray:
	frame.encode_u32(0, frame.size() - HEADER_BYTES)
	return frame


## Returns a whole frame with a JSON payload.
static func json_frame(type: LudusWire.Type, value: Dictionary) -> PackedByteArray:
	var frame := begin(type)
	frame.append_array(JSON.stringify(value, "", false, true).to_utf8_buffer())
	return finish(frame)


## Returns a whole frame with the given payload.
static func raw_frame(type: LudusWire.Type, payload: PackedByteArray) -> PackedByteArray:
	var frame := begin(type)
	frame.append_array(payload)
	return finish(frame)


## Largest payload a trainer may send in a frame of this type; -1 if it may not send the type.
static func max_payload_bytes(type: int) -> int:
	match type:
		Type.WELCOME, Type.CALL, Type.ERROR:
			return MAX_JSON_BYTES
		Type.RESET, Type.STEP:
			return MAX_PAYLOAD_BYTES
		Type.PING:
			return MAX_PING_BYTES
		Type.CLOSE:
			return 0
	return -1


## Appends zeros up to a multiple of 8 bytes. Header and alignment are both 8, so the length of
## the frame may stand for the length of the payload.
static func pad(frame: PackedByteArray) -> void:
	var rest := frame.size() & 7
	if rest != 0:
		frame.resize(frame.size() + 8 - rest)


## Number of bytes with padding to a multiple of 8.
static func padded(num_bytes: int) -> int:
	return (num_bytes + 7) & ~7


## Reads the JSON object of a payload; null if it is none.
static func read_json(payload: PackedByteArray) -> Variant:
	var json := JSON.new()
	if json.parse(payload.get_string_from_utf8()) != OK or json.data is not Dictionary:
		return null
	return json.data


## Reads a [code]RESET[/code] (PROTOCOL.md §5) for [param num_worlds] worlds: a dictionary of
## [code]seeds[/code], [code]actions[/code] and [code]parameters[/code]; empty if it is malformed.
static func read_reset(payload: PackedByteArray, num_worlds: int) -> Dictionary:
	var head := 8 + padded(num_worlds * 9)
	if payload.size() < head or payload.decode_u32(0) != num_worlds:
		return {}
	if payload.size() != head + payload.decode_u32(4):
		return {}
	var actions := payload.slice(8 + num_worlds * 8, 8 + num_worlds * 9)
	for action: int in actions:
		if action > ResetAction.SEED:
			return {}
	var json := JSON.new()
	var text := payload.slice(head).get_string_from_utf8()
	if json.parse(text) != OK or not _are_parameters(json.data, num_worlds):
		return {}
	return {
		"seeds": payload.slice(8, 8 + num_worlds * 8).to_int64_array(),
		"actions": actions,
		"parameters": json.data,
	}


static func _are_parameters(value: Variant, num_worlds: int) -> bool:
	if value == null or value is Dictionary:
		return true
	if value is not Array or len(value) != num_worlds:
		return false
	for item: Variant in value:
		if item != null and item is not Dictionary:
			return false
	return true


## Writes a [code]RESET[/code]; the counterpart of [method read_reset], for tests of the format.
static func reset_frame(
	seeds: PackedInt64Array, actions: PackedByteArray, parameters: Variant
) -> PackedByteArray:
	var text := JSON.stringify(parameters).to_utf8_buffer()
	var frame := begin(Type.RESET)
	frame.resize(HEADER_BYTES + 8)
	frame.encode_u32(HEADER_BYTES, seeds.size())
	frame.encode_u32(HEADER_BYTES + 4, text.size())
	frame.append_array(seeds.to_byte_array())
	frame.append_array(actions)
	pad(frame)
	frame.append_array(text)
	return finish(frame)
