extends "ludus_test.gd"
## Entries inferred from what a game returns, and its values as bytes.

const FLOAT32 := LudusObservationEntry.DType.FLOAT32
const UINT8 := LudusObservationEntry.DType.UINT8
const INT64 := LudusObservationEntry.DType.INT64


func test_inference() -> void:
	_check_inferred(PoolRealArray([1, 2, 3]), FLOAT32, [3])
	_check_inferred([1, 2.5, 3, 4], FLOAT32, [4])
	_check_inferred(PoolByteArray([1, 2]), UINT8, [2])
	_check_inferred(PoolIntArray([1, 2]), INT64, [2])
	_check_inferred(1.5, FLOAT32, [1])
	_check_inferred(7, FLOAT32, [1])
	_check_inferred(true, FLOAT32, [1])
	_check_inferred(_image(5, 4, Image.FORMAT_RGB8), UINT8, [4, 5, 3])
	_check_inferred(_image(2, 3, Image.FORMAT_L8), UINT8, [3, 2, 1])


func test_what_is_no_numbers_is_not_inferred() -> void:
	for value in ["text", null, {}, Vector2.ONE, Reference.new(), NodePath("a"), ["a"]]:
		check(LudusObservationEntry.infer("x", value) == null, str(value))


func test_inferred_entries_take_the_value() -> void:
	var image := _image(5, 4, Image.FORMAT_RGB8)
	for value in [
		PoolRealArray([1, 2]),
		[1, 2],
		PoolByteArray([1, 2]),
		PoolIntArray([1, 2]),
		1.5,
		7,
		true,
		image
	]:
		var entry: LudusObservationEntry = LudusObservationEntry.infer("x", value)
		equal(entry.to_bytes(value).size(), entry.num_bytes(), str(value))


func test_floats_as_bytes() -> void:
	for value in [PoolRealArray([1, -2]), [1, -2.0], PoolIntArray([1, -2])]:
		equal(_bytes([2], FLOAT32, value), "0000803f000000c0", str(value))
	for value in [1.0, 1, true]:
		equal(_bytes([1], FLOAT32, value), "0000803f", str(value))


func test_bytes_as_bytes() -> void:
	for value in [PoolByteArray([1, 255]), [1, 255]]:
		equal(_bytes([2], UINT8, value), "01ff", str(value))


func test_integers_as_bytes() -> void:
	for value in [PoolIntArray([1, 9]), PoolByteArray([1, 9]), [1, 9]]:
		equal(_bytes([2], INT64, value), "01000000000000000900000000000000", str(value))
	for value in [1, true]:
		equal(_bytes([1], INT64, value), "0100000000000000", str(value))


func test_images_as_bytes() -> void:
	var image := _image(2, 1, Image.FORMAT_RGB8)
	image.lock()
	image.set_pixel(1, 0, Color8(1, 2, 3))
	image.unlock()
	equal(_bytes([1, 2, 3], UINT8, image), "000000010203", "an image")
	equal(_bytes([1, 2, 4], UINT8, image), "", "another format")


func test_what_does_not_fit_is_refused() -> void:
	for value in [null, "text", {}, [], [1], [1, 2, 3], PoolRealArray([1]), 1.0]:
		for dtype in [FLOAT32, UINT8, INT64]:
			equal(_bytes([2], dtype, value), "", str(value))


func test_lists_of_other_things_are_refused() -> void:
	for value in [["a", "b"], [null, 1.0], [[1], [2]], [Vector2.ONE, Vector2.ONE]]:
		for dtype in [FLOAT32, UINT8, INT64]:
			equal(_bytes([2], dtype, value), "", str(value))


func test_description() -> void:
	var entry := _entry([2, 3], UINT8)
	entry.low = 0.0
	equal(
		entry.to_json(),
		{"name": "x", "dtype": "uint8", "shape": [2, 3], "low": 0.0, "high": null},
		"to_json"
	)
	equal(entry.size(), 6, "size")
	equal(_entry([2, 3], INT64).num_bytes(), 48, "num_bytes")


func test_types_have_names() -> void:
	equal(LudusObservationEntry.TYPE_NAMES.size(), TYPE_MAX, "all types")
	equal(LudusObservationEntry.describe_value(null), "null", "nothing")
	equal(LudusObservationEntry.describe_value(PoolRealArray([1])), "PoolRealArray of 1", "reals")


func _image(width: int, height: int, format: int) -> Image:
	var image := Image.new()
	image.create(width, height, false, format)
	return image


func _entry(shape: Array, dtype: int) -> LudusObservationEntry:
	return LudusObservationEntry.create("x", PoolIntArray(shape), dtype) as LudusObservationEntry


func _bytes(shape: Array, dtype: int, value) -> String:
	return _entry(shape, dtype).to_bytes(value).hex_encode()


func _check_inferred(value, dtype: int, shape: Array) -> void:
	var entry: LudusObservationEntry = LudusObservationEntry.infer("x", value)
	check(entry != null, "%s is not inferred" % [value])
	if entry != null:
		equal(entry.dtype, dtype, str(value))
		equal(entry.shape, PoolIntArray(shape), str(value))
