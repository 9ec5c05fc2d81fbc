extends "ludus_test.gd"
## JSON with all the digits of a number.


func test_numbers_keep_their_value() -> void:
	for number in [0.1, 1e-8, 3.141592653589793, -2.5, 1.5e300, 5e-300, 123456789.123456, 0.0003]:
		var read: float = JSON.parse(LudusJson.write(number)).result
		check(abs(read - number) <= abs(number) * 1e-13, "%s became %s" % [number, read])


func test_whole_numbers() -> void:
	equal(LudusJson.write(60.0), "60", "a float")
	equal(LudusJson.write(9007199254740991), "9007199254740991", "an integer")
	equal(LudusJson.write(-3.0), "-3", "a negative float")


func test_numbers_that_json_lacks() -> void:
	for number in [INF, -INF, NAN]:
		equal(LudusJson.write(number), "null", str(number))


func test_everything_else() -> void:
	var value := {"a": [true, null, 'Ziel ✓ "x"'], "b": {"c": PoolIntArray([1, 2])}, "d": {}}
	var expected := '{"a":[true,null,"Ziel ✓ \\"x\\""],"b":{"c":[1,2]},"d":{}}'
	equal(LudusJson.write(value), expected, "a value of everything")
