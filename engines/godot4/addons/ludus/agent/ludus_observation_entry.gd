@tool
@icon("res://addons/ludus/icons/ludus_observation_entry.svg")
class_name LudusObservationEntry
extends Resource
## One named array of an observation.

## Type of the elements on the wire.
enum DType {
	FLOAT32,  ## Numbers.
	UINT8,  ## Bytes, above all images with channels last.
	INT64,  ## Whole numbers.
}

const DTYPE_NAMES: PackedStringArray = ["float32", "uint8", "int64"]
const DTYPE_BYTES: PackedInt32Array = [4, 1, 8]

## Key in the dictionary that [code]get_observation()[/code] returns.
@export var name: String = "observation":
	set(value):
		name = value
		emit_changed()
## Type of the elements.
@export var dtype: LudusObservationEntry.DType = DType.FLOAT32:
	set(value):
		dtype = value
		emit_changed()
## Shape for one agent, for example [code][4][/code] or [code][84, 84, 3][/code].
@export var shape: PackedInt32Array = [1]:
	set(value):
		shape = value
		emit_changed()
## Smallest value of any element; -inf if unbounded.
@export var low: float = -INF
## Largest value of any element; inf if unbounded.
@export var high: float = INF


## Makes an entry in code.
static func create(
	entry_name: String,
	entry_shape: PackedInt32Array,
	entry_dtype: LudusObservationEntry.DType = DType.FLOAT32
) -> LudusObservationEntry:
	var entry := LudusObservationEntry.new()
	entry.name = entry_name
	entry.shape = entry_shape
	entry.dtype = entry_dtype
	return entry


## Makes the entry that fits a value returned by [code]get_observation()[/code].
## Returns null for a value that is no array of numbers.
static func infer(entry_name: String, value: Variant) -> LudusObservationEntry:
	match typeof(value):
		TYPE_PACKED_FLOAT32_ARRAY, TYPE_PACKED_FLOAT64_ARRAY:
			return create(entry_name, [len(value)])
		TYPE_ARRAY:
			return create(entry_name, [len(value)]) if _are_numbers(value) else null
		TYPE_PACKED_BYTE_ARRAY:
			return create(entry_name, [len(value)], DType.UINT8)
		TYPE_PACKED_INT64_ARRAY, TYPE_PACKED_INT32_ARRAY:
			return create(entry_name, [len(value)], DType.INT64)
		TYPE_FLOAT, TYPE_INT, TYPE_BOOL:
			return create(entry_name, [1])
		TYPE_OBJECT:
			return _infer_image(entry_name, value as Image)
	return null


static func _infer_image(entry_name: String, image: Image) -> LudusObservationEntry:
	if image == null:
		return null
	var pixels := image.get_width() * image.get_height()
	var channels := image.get_data().size() / maxi(pixels, 1)
	return create(entry_name, [image.get_height(), image.get_width(), channels], DType.UINT8)


## Number of elements for one agent.
func size() -> int:
	var product := 1
	for length: int in shape:
		product *= length
	return product


## Number of bytes for one agent.
func num_bytes() -> int:
	return size() * DTYPE_BYTES[dtype]


## Turns a value returned by the game into wire bytes; empty if the value does not fit.
func to_bytes(value: Variant) -> PackedByteArray:
	var bytes := PackedByteArray()
	if value is Image:
		bytes = (value as Image).get_data()
	elif value is not Array or _are_numbers(value):
		match dtype:
			DType.FLOAT32:
				bytes = floats(value).to_byte_array()
			DType.UINT8:
				if value is PackedByteArray or value is Array:
					bytes = PackedByteArray(value)
			DType.INT64:
				bytes = _integers(value).to_byte_array()
	return bytes if bytes.size() == num_bytes() else PackedByteArray()


## Godot turns anything else in a list into zeros without a word.
static func _are_numbers(values: Array) -> bool:
	for value: Variant in values:
		if value is not float and value is not int and value is not bool:
			return false
	return true


## Turns a value returned by the game into floats; empty if it is no array of numbers.
static func floats(value: Variant) -> PackedFloat32Array:
	match typeof(value):
		TYPE_PACKED_FLOAT32_ARRAY:
			return value
		TYPE_PACKED_FLOAT64_ARRAY, TYPE_PACKED_INT32_ARRAY, TYPE_PACKED_INT64_ARRAY:
			return PackedFloat32Array(Array(value))
		TYPE_ARRAY:
			return PackedFloat32Array(value)
		TYPE_FLOAT, TYPE_INT, TYPE_BOOL:
			return PackedFloat32Array([float(value)])
	return PackedFloat32Array()


static func _integers(value: Variant) -> PackedInt64Array:
	match typeof(value):
		TYPE_PACKED_INT64_ARRAY:
			return value
		TYPE_PACKED_INT32_ARRAY, TYPE_PACKED_BYTE_ARRAY, TYPE_ARRAY:
			return PackedInt64Array(Array(value))
		TYPE_INT, TYPE_BOOL:
			return PackedInt64Array([int(value)])
	return PackedInt64Array()


## Describes the entry for the handshake (PROTOCOL.md §4).
func to_json() -> Dictionary:
	return {
		"name": name,
		"dtype": DTYPE_NAMES[dtype],
		"shape": Array(shape),
		"low": low if is_finite(low) else null,
		"high": high if is_finite(high) else null,
	}


## Name, type, shape and bounds, for people to read.
func describe() -> String:
	var text := "%s  %s%s" % [name, DTYPE_NAMES[dtype], shape]
	if dtype == DType.UINT8 and not is_finite(low) and not is_finite(high):
		return text
	return text + "  %s to %s" % [_describe_bound(low), _describe_bound(high)]


static func _describe_bound(bound: float) -> String:
	return String.num(bound, 4) if is_finite(bound) else ("-∞" if bound < 0.0 else "∞")
