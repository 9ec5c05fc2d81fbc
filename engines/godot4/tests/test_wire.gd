extends "ludus_test.gd"
## Payloads that are not allowed, limits and padding.

const LudusLink := preload("res://addons/ludus/bridge/link.gd")
const LudusWire := preload("res://addons/ludus/bridge/wire.gd")

const SEEDS: PackedInt64Array = [1, 2]
const ACTIONS: PackedByteArray = [2, 0]


func test_padding() -> void:
	for pair: Array in [[0, 0], [1, 8], [7, 8], [8, 8], [9, 16]]:
		equal(LudusWire.padded(pair[0]), pair[1], "padded(%d)" % pair[0])
		var frame := PackedByteArray()
		frame.resize(pair[0])
		LudusWire.pad(frame)
		equal(frame.size(), pair[1], "pad(%d)" % pair[0])


func test_padding_is_zero() -> void:
	var frame := PackedByteArray([255])
	LudusWire.pad(frame)
	equal(frame.hex_encode(), "ff00000000000000", "padding")


func test_a_trainer_may_send_only_its_own_frames() -> void:
	var limits := {
		LudusWire.Type.WELCOME: 16777216,
		LudusWire.Type.RESET: 268435456,
		LudusWire.Type.STEP: 268435456,
		LudusWire.Type.CALL: 16777216,
		LudusWire.Type.PING: 1048576,
		LudusWire.Type.ERROR: 16777216,
		LudusWire.Type.CLOSE: 0,
	}
	for type: int in range(0, 256):
		equal(LudusWire.max_payload_bytes(type), limits.get(type, -1), "type %d" % type)


func test_only_addresses_of_this_machine_are_local() -> void:
	for pair: Array in [
		["tcp:127.0.0.1:1", true],
		["tcp:127.9.9.9:1", true],
		["tcp:[::1]:1", true],
		["tcp:localhost:1", true],
		["tcp:127.0.0.1.evil.example:1", false],
		["tcp:127.evil.example:1", false],
		["tcp:localhost.evil.example:1", false],
		["tcp:0.0.0.0:1", false],
		["tcp:192.168.0.1:1", false],
		["tcp:[::1.evil.example]:1", false],
	]:
		equal(LudusLink.is_loopback(pair[0]), pair[1], pair[0])


func test_json_must_be_an_object() -> void:
	for text: String in ["", "[]", "7", "null", '"text"', "{", "{} {}"]:
		equal(LudusWire.read_json(text.to_utf8_buffer()), null, text)
	equal(LudusWire.read_json("{}".to_utf8_buffer()), {}, "an empty object")


func test_json_keeps_large_numbers() -> void:
	var frame := LudusWire.json_frame(LudusWire.Type.RESULT, {"value": 0.1, "id": 9007199254740991})
	var read: Dictionary = LudusWire.read_json(frame.slice(8))
	equal(read["value"], 0.1, "a float")
	equal(int(read["id"]), 9007199254740991, "an integer")


func test_a_right_reset_is_read() -> void:
	check(not LudusWire.read_reset(_payload({}), 2).is_empty(), "the example is right")


func test_a_reset_for_other_worlds_is_refused() -> void:
	for num_worlds: int in [0, 1, 3, 4096]:
		equal(LudusWire.read_reset(_payload({}), num_worlds), {}, "%d worlds" % num_worlds)


func test_a_cut_reset_is_refused() -> void:
	var payload := _payload({"a": 1.5})
	for size: int in payload.size():
		equal(LudusWire.read_reset(payload.slice(0, size), 2), {}, "%d bytes" % size)
	payload.append(32)
	equal(LudusWire.read_reset(payload, 2), {}, "a byte too many")


func test_an_unknown_action_is_refused() -> void:
	var payload := _payload(null)
	payload[8 + 16] = 3
	equal(LudusWire.read_reset(payload, 2), {}, "action 3")


func test_parameters_must_be_objects() -> void:
	for right: Variant in [null, {}, [null, {}], [{"a": [1.5]}, {}]]:
		check(not LudusWire.read_reset(_payload(right), 2).is_empty(), var_to_str(right))
	for wrong: Variant in [7.0, "a", true, [], [null], [null, 7.0], [{}, {}, {}]]:
		equal(LudusWire.read_reset(_payload(wrong), 2), {}, var_to_str(wrong))


func _payload(parameters: Variant) -> PackedByteArray:
	return LudusWire.reset_frame(SEEDS, ACTIONS, parameters).slice(LudusWire.HEADER_BYTES)
