extends "ludus_test.gd"
## Payloads that are not allowed, limits and padding.

const SEEDS := [1, 2]


func test_padding() -> void:
	for pair in [[0, 0], [1, 8], [7, 8], [8, 8], [9, 16]]:
		equal(LudusWire.padded(pair[0]), pair[1], "padded(%d)" % pair[0])
		equal(LudusWire.pad(LudusWire.zeros(pair[0])).size(), pair[1], "pad(%d)" % pair[0])


func test_padding_is_zero() -> void:
	var bytes := LudusWire.pad(PoolByteArray([255]))
	equal(bytes.hex_encode(), "ff00000000000000", "padding")


func test_numbers_as_bytes() -> void:
	var reals := LudusWire.float_bytes(PoolRealArray([1.0, -2.5]))
	equal(reals.hex_encode(), "0000803f000020c0", "floats")
	equal(Array(LudusWire.read_floats(reals, 4, 1)), [-2.5], "a float")
	equal(LudusWire.int_bytes(PoolIntArray([1, 256])).hex_encode(), "0100000000010000", "integers")
	equal(LudusWire.long_bytes([3]).hex_encode(), "0300000000000000", "a long")
	equal(LudusWire.read_choices(LudusWire.long_bytes([7, 3, 1048575]), 8, 2), [3, 1048575], "two")
	equal(LudusWire.read_choices(PoolByteArray(), 0, 0), [], "none")
	equal(LudusWire.read_u32(PoolByteArray([0, 1, 2, 3, 255]), 1), 0xff030201, "unsigned")


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
	for type in range(0, 256):
		equal(LudusWire.max_payload_bytes(type), limits.get(type, -1), "type %d" % type)


func test_only_addresses_of_this_machine_are_local() -> void:
	for pair in [
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
	for text in ["", "[]", "7", "null", '"text"', "{", "{} {}"]:
		equal(LudusWire.read_json(text.to_utf8()), null, text)
	equal(LudusWire.read_json("{}".to_utf8()), {}, "an empty object")


func test_a_right_reset_is_read() -> void:
	check(not LudusWire.read_reset(_payload({}), 2).empty(), "the example is right")


func test_a_reset_for_other_worlds_is_refused() -> void:
	for num_worlds in [0, 1, 3, 4096]:
		equal(LudusWire.read_reset(_payload({}), num_worlds), {}, "%d worlds" % num_worlds)


func test_a_cut_reset_is_refused() -> void:
	var payload := _payload({"a": 1.5})
	equal(LudusWire.read_reset(PoolByteArray(), 2), {}, "no bytes")
	for last in payload.size() - 1:
		equal(LudusWire.read_reset(payload.subarray(0, last), 2), {}, "%d bytes" % (last + 1))
	payload.append(32)
	equal(LudusWire.read_reset(payload, 2), {}, "a byte too many")


func test_an_unknown_action_is_refused() -> void:
	var payload := _payload(null)
	payload[8 + 16] = 3
	equal(LudusWire.read_reset(payload, 2), {}, "action 3")


func test_parameters_must_be_objects() -> void:
	for right in [null, {}, [null, {}], [{"a": [1.5]}, {}]]:
		check(not LudusWire.read_reset(_payload(right), 2).empty(), str(right))
	for wrong in [7.0, "a", true, [], [null], [null, 7.0], [{}, {}, {}]]:
		equal(LudusWire.read_reset(_payload(wrong), 2), {}, str(wrong))


func _payload(parameters) -> PoolByteArray:
	var frame := LudusWire.reset_frame(SEEDS, PoolByteArray([2, 0]), parameters)
	return frame.subarray(LudusWire.HEADER_BYTES, -1)
