extends "ludus_test.gd"
## Entries inferred from what a game returns, and its values as bytes.

const FLOAT32 := LudusObservationEntry.DType.FLOAT32
const UINT8 := LudusObservationEntry.DType.UINT8
const INT64 := LudusObservationEntry.DType.INT64


func test_inference() -> void:
	_check_inferred(PackedFloat32Array([1, 2, 3]), FLOAT32, [3])
	_check_inferred(PackedFloat64Array([1, 2]), FLOAT32, [2])
	_check_inferred([1, 2.5, 3, 4], FLOAT32, [4])
	_check_inferred([1.5] as Array[float], FLOAT32, [1])
	_check_inferred(PackedByteArray([1, 2]), UINT8, [2])
	_check_inferred(PackedInt64Array([1]), INT64, [1])
	_check_inferred(PackedInt32Array([1, 2]), INT64, [2])
	_check_inferred(1.5, FLOAT32, [1])
	_check_inferred(7, FLOAT32, [1])
	_check_inferred(true, FLOAT32, [1])
	_check_inferred(Image.create_empty(5, 4, false, Image.FORMAT_RGB8), UINT8, [4, 5, 3])
	_check_inferred(Image.create_empty(2, 3, false, Image.FORMAT_L8), UINT8, [3, 2, 1])


func test_what_is_no_numbers_is_not_inferred() -> void:
	for value: Variant in ["text", null, {}, Vector2.ONE, Node, RefCounted.new(), ^"a"]:
		check(LudusObservationEntry.infer("x", value) == null, var_to_str(value))


func test_inferred_entries_take_the_value() -> void:
	var image := Image.create_empty(5, 4, false, Image.FORMAT_RGB8)
	for value: Variant in [
		PackedFloat32Array([1, 2]),
		PackedFloat64Array([1, 2]),
		[1, 2],
		PackedByteArray([1, 2]),
		PackedInt64Array([1, 2]),
		PackedInt32Array([1, 2]),
		1.5,
		7,
		true,
		image
	]:
		var entry := LudusObservationEntry.infer("x", value)
		equal(entry.to_bytes(value).size(), entry.num_bytes(), type_string(typeof(value)))


func test_floats_as_bytes() -> void:
	var expected := PackedFloat32Array([1.0, -2.0]).to_byte_array()
	for value: Variant in [
		PackedFloat32Array([1, -2]),
		PackedFloat64Array([1, -2]),
		[1, -2.0],
		PackedInt32Array([1, -2]),
		PackedInt64Array([1, -2])
	]:
		equal(_entry([2], FLOAT32).to_bytes(value), expected, type_string(typeof(value)))
	var one := PackedFloat32Array([1.0]).to_byte_array()
	for value: Variant in [1.0, 1, true]:
		equal(_entry([1], FLOAT32).to_bytes(value), one, type_string(typeof(value)))


func test_bytes_as_bytes() -> void:
	for value: Variant in [PackedByteArray([1, 255]), [1, 255]]:
		equal(_entry([2], UINT8).to_bytes(value).hex_encode(), "01ff", type_string(typeof(value)))


func test_integers_as_bytes() -> void:
	var expected := PackedInt64Array([1, 9]).to_byte_array()
	for value: Variant in [
		PackedInt64Array([1, 9]), PackedInt32Array([1, 9]), PackedByteArray([1, 9]), [1, 9]
	]:
		equal(_entry([2], INT64).to_bytes(value), expected, type_string(typeof(value)))
	var one := PackedInt64Array([1]).to_byte_array()
	for value: Variant in [1, true]:
		equal(_entry([1], INT64).to_bytes(value), one, type_string(typeof(value)))


func test_images_as_bytes() -> void:
	var image := Image.create_empty(2, 1, false, Image.FORMAT_RGB8)
	image.set_pixel(1, 0, Color8(1, 2, 3))
	equal(_entry([1, 2, 3], UINT8).to_bytes(image).hex_encode(), "000000010203", "an image")
	equal(_entry([1, 2, 4], UINT8).to_bytes(image), PackedByteArray(), "another format")


func test_what_does_not_fit_is_refused() -> void:
	for value: Variant in [null, "text", {}, [], [1], [1, 2, 3], PackedFloat32Array([1]), 1.0]:
		for dtype: LudusObservationEntry.DType in [FLOAT32, UINT8, INT64]:
			equal(_entry([2], dtype).to_bytes(value), PackedByteArray(), var_to_str(value))


func test_lists_of_other_things_are_refused() -> void:
	for value: Variant in [["a", "b"], [null, 1.0], [[1], [2]], [Vector2.ONE, Vector2.ONE]]:
		for dtype: LudusObservationEntry.DType in [FLOAT32, UINT8, INT64]:
			equal(_entry([2], dtype).to_bytes(value), PackedByteArray(), var_to_str(value))


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


func _entry(shape: PackedInt32Array, dtype: LudusObservationEntry.DType) -> LudusObservationEntry:
	return LudusObservationEntry.create("x", shape, dtype)


func _check_inferred(
	value: Variant, dtype: LudusObservationEntry.DType, shape: PackedInt32Array
) -> void:
	var entry := LudusObservationEntry.infer("x", value)
	var what := type_string(typeof(value))
	check(entry != null, what + " is not inferred")
	if entry != null:
		equal(int(entry.dtype), int(dtype), what)
		equal(entry.shape, shape, what)
