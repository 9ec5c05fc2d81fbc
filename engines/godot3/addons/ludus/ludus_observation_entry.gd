tool
class_name LudusObservationEntry, "res://addons/ludus/icons/ludus_observation_entry.svg"
extends Resource
## One named array of an observation.

## Type of the elements on the wire: FLOAT32 for numbers, UINT8 for bytes, above all images with
## channels last, INT64 for whole numbers.
enum DType { FLOAT32, UINT8, INT64 }

const DTYPE_NAMES := ["float32", "uint8", "int64"]
const DTYPE_BYTES := [4, 1, 8]
const TYPE_NAMES := [
	"null",
	"bool",
	"int",
	"float",
	"String",
	"Vector2",
	"Rect2",
	"Vector3",
	"Transform2D",
	"Plane",
	"Quat",
	"AABB",
	"Basis",
	"Transform",
	"Color",
	"NodePath",
	"RID",
	"Object",
	"Dictionary",
	"Array",
	"PoolByteArray",
	"PoolIntArray",
	"PoolRealArray",
	"PoolStringArray",
	"PoolVector2Array",
	"PoolVector3Array",
	"PoolColorArray",
]

## Key in the dictionary that [code]get_observation()[/code] returns.
export var name: String = "observation"
## Type of the elements.
export(DType) var dtype: int = DType.FLOAT32
## Shape for one agent, for example [code][4][/code] or [code][84, 84, 3][/code].
export var shape: PoolIntArray = PoolIntArray([1])
## Smallest value of any element; -inf if unbounded.
export var low: float = -INF
## Largest value of any element; inf if unbounded.
export var high: float = INF


## Makes an entry in code.
static func create(
	entry_name: String, entry_shape: PoolIntArray, entry_dtype: int = DType.FLOAT32
) -> Resource:
	# A class of Godot 3 cannot name itself.
	var entry: Resource = load("res://addons/ludus/ludus_observation_entry.gd").new()
	entry.name = entry_name
	entry.shape = entry_shape
	entry.dtype = entry_dtype
	return entry


## Makes the entry that fits a value returned by [code]get_observation()[/code].
## Returns null for a value that is no array of numbers.
static func infer(entry_name: String, value) -> Resource:
	match typeof(value):
		TYPE_REAL_ARRAY:
			return create(entry_name, PoolIntArray([value.size()]))
		TYPE_ARRAY:
			var length := PoolIntArray([value.size()])
			return create(entry_name, length) if _are_numbers(value) else null
		TYPE_RAW_ARRAY:
			return create(entry_name, PoolIntArray([value.size()]), DType.UINT8)
		TYPE_INT_ARRAY:
			return create(entry_name, PoolIntArray([value.size()]), DType.INT64)
		TYPE_REAL, TYPE_INT, TYPE_BOOL:
			return create(entry_name, PoolIntArray([1]))
		TYPE_OBJECT:
			return _infer_image(entry_name, value as Image)
	return null


## Names the type of a value, and its size if it has one, for messages.
static func describe_value(value) -> String:
	var text: String = TYPE_NAMES[typeof(value)]
	if typeof(value) >= TYPE_DICTIONARY:
		text += " of %d" % value.size()
	return text


## Number of elements for one agent.
func size() -> int:
	var product := 1
	for length in shape:
		product *= length
	return product


## Number of bytes for one agent.
func num_bytes() -> int:
	return size() * int(DTYPE_BYTES[dtype])


## Turns a value returned by the game into wire bytes; empty if the value does not fit.
func to_bytes(value) -> PoolByteArray:
	var bytes := PoolByteArray()
	if value is Image:
		bytes = value.get_data()
	elif not value is Array or _are_numbers(value):
		match dtype:
			DType.FLOAT32:
				bytes = LudusWire.float_bytes(floats(value))
			DType.UINT8:
				if value is PoolByteArray or value is Array:
					bytes = PoolByteArray(value)
			DType.INT64:
				bytes = LudusWire.long_bytes(_integers(value))
	return bytes if bytes.size() == num_bytes() else PoolByteArray()


## Turns a value returned by the game into floats; empty if it is no array of numbers.
static func floats(value) -> PoolRealArray:
	match typeof(value):
		TYPE_REAL_ARRAY:
			return value
		TYPE_ARRAY:
			return PoolRealArray(value)
		TYPE_INT_ARRAY:
			return PoolRealArray(Array(value))
		TYPE_REAL, TYPE_INT, TYPE_BOOL:
			return PoolRealArray([float(value)])
	return PoolRealArray()


## Describes the entry for the handshake (PROTOCOL.md §4).
func to_json() -> Dictionary:
	return {
		"name": name,
		"dtype": DTYPE_NAMES[dtype],
		"shape": Array(shape),
		"low": null if is_inf(low) else low,
		"high": null if is_inf(high) else high,
	}


static func _infer_image(entry_name: String, image: Image) -> Resource:
	if image == null:
		return null
	var pixels := image.get_width() * image.get_height()
	var channels := image.get_data().size() / int(max(pixels, 1))
	var image_shape := PoolIntArray([image.get_height(), image.get_width(), channels])
	return create(entry_name, image_shape, DType.UINT8)


## Godot turns anything else in a list into zeros without a word.
static func _are_numbers(values: Array) -> bool:
	for value in values:
		if not (value is float or value is int or value is bool):
			return false
	return true


static func _integers(value) -> Array:
	match typeof(value):
		TYPE_INT_ARRAY, TYPE_RAW_ARRAY, TYPE_ARRAY:
			return Array(value)
		TYPE_INT, TYPE_BOOL:
			return [int(value)]
	return []
