extends "ludus_test.gd"
## Answers of godot_gym_api's classes in JSON.

const RlJson := preload("../addons/ludus_classic/rl_json.gd")


func test_numbers_keep_their_value() -> void:
	for number in [0.1, 1e-8, 3.141592653589793, -2.5, 1.5e300, 5e-300, 123456789.123456, 0.0003]:
		var read: float = JSON.parse(RlJson.write(number)).result
		check(abs(read - number) <= abs(number) * 1e-13, "%s became %s" % [number, read])


func test_lists_of_numbers_keep_their_values() -> void:
	for list in [[0.1, -2.5, 0.0, 14.0], [0.5, 1e-9], [1e20, 2.0], [3.0], [1.0, 2]]:
		var read: Array = JSON.parse(RlJson.write(list)).result
		equal(read.size(), list.size(), "number of items")
		for index in list.size():
			var error := abs(read[index] - list[index])
			check(error <= abs(list[index]) * 1e-13, "%s became %s" % [list, read])


func test_integers() -> void:
	equal(RlJson.write([60, -7]), "[60,-7]", "small ones")
	equal(RlJson.write(9007199254740991), "9007199254740991", "a large one")


func test_numbers_that_json_lacks() -> void:
	equal(RlJson.write([INF, -INF, NAN]), "[inf,-inf,nan]", "numbers")


func test_what_engines_have() -> void:
	equal(_read(Vector2(1, 0.5)), [1.0, 0.5], "Vector2")
	equal(_read(Vector3(1, -2, 0.5)), [1.0, -2.0, 0.5], "Vector3")
	equal(_read(Quat(0, 0.5, 0, 1)), [0.0, 0.5, 0.0, 1.0], "Quat")
	equal(_read(Color(1, 0, 0.5, 1)), [1.0, 0.0, 0.5, 1.0], "Color")
	equal(_read(PoolRealArray([0.25, 2])), [0.25, 2.0], "PoolRealArray")
	equal(RlJson.write(PoolIntArray([3, -2])), "[3,-2]", "PoolIntArray")
	equal(_read(PoolVector2Array([Vector2(1, 2)])), [[1.0, 2.0]], "PoolVector2Array")
	equal(RlJson.write(PoolByteArray([0, 255, 10])), '{"$bytes":"AP8K"}', "PoolByteArray")


func test_everything_else() -> void:
	var value := {"a": [true, null, 'Ziel ✓ "x"'], 'b "': {"c": [[1], []]}, "3": {}}
	var expected := '{"a":[true,null,"Ziel ✓ \\"x\\""],"b \\"":{"c":[[1],[]]},"3":{}}'
	equal(RlJson.write(value), expected, "a value of everything")


func _read(value) -> Array:
	return JSON.parse(RlJson.write(value)).result
