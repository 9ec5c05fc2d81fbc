@tool
extends RefCounted
## Typed access to one JSON object of a policy file. Mistakes are noted with their place.

const LudusPolicyFields := preload("res://addons/ludus/policy/policy_fields.gd")

const MAX_ELEMENTS := 33554432

## What is wrong, one line each; shared by all parts of a file.
var errors: Array[String] = []

var _object: Dictionary = {}
var _where: String = ""


func _init(value: Variant, where: String, noted: Array[String]) -> void:
	errors = noted
	_where = where
	if value is Dictionary:
		_object = value
	else:
		var place := where.trim_suffix(".") if not where.is_empty() else "the whole"
		errors.append("%s: expected an object, got %s" % [place, type_string(typeof(value))])


## Notes a mistake.
func fail(key: String, what: String) -> void:
	errors.append("%s%s: %s" % [_where, key, what])


## Whether a field is there.
func has(key: String) -> bool:
	return _object.has(key)


## Whether a field is null.
func is_null(key: String) -> bool:
	return _object.has(key) and _object[key] == null


## A field as it is.
func raw(key: String) -> Variant:
	if not _object.has(key):
		fail(key, "missing")
	return _object.get(key)


## A text.
func text(key: String) -> String:
	var value: Variant = raw(key)
	if value is String:
		return value
	fail(key, "expected a text, got %s" % _short(value))
	return ""


## A text out of some; returns its index.
func choice(key: String, choices: PackedStringArray) -> int:
	var index := choices.find(text(key))
	if index < 0:
		fail(key, "expected one of %s, got %s" % [", ".join(choices), _short(raw(key))])
	return maxi(index, 0)


## True or false.
func flag(key: String) -> bool:
	var value: Variant = raw(key)
	if value is bool:
		return value
	fail(key, "expected true or false, got %s" % _short(value))
	return false


## A finite number.
func number(key: String) -> float:
	return _finite(key, raw(key))


## A whole number between two bounds.
func integer(key: String, low: int, high: int) -> int:
	var value := number(key)
	if value != floorf(value) or value < low or value > high:
		fail(key, "expected an integer from %d to %d, got %s" % [low, high, _short(raw(key))])
		return low
	return int(value)


## A list of numbers, or one number for all of [param count].
func numbers(key: String, count: int) -> PackedFloat32Array:
	var value: Variant = raw(key)
	var found := PackedFloat32Array()
	if value is not Array:
		found.resize(count)
		found.fill(_finite(key, value))
	elif len(value) != count:
		fail(key, "expected %d numbers, got %d" % [count, len(value)])
		found.resize(count)
	else:
		for item: Variant in value:
			found.append(_finite(key, item))
	return found


## A list of sizes.
func sizes(key: String, max_count: int) -> PackedInt32Array:
	var value: Variant = raw(key)
	var found := PackedInt32Array()
	if value is not Array or len(value) < 1 or len(value) > max_count:
		fail(key, "expected 1 to %d sizes, got %s" % [max_count, _short(value)])
		return found
	var product := 1.0
	for item: Variant in value:
		var size := _finite(key, item)
		product *= size
		if size < 0 or size != floorf(size) or product > MAX_ELEMENTS:
			fail(key, "expected sizes, got %s" % _short(value))
			return PackedInt32Array()
		found.append(int(size))
	return found


## An object inside this one.
func part(key: String) -> LudusPolicyFields:
	return LudusPolicyFields.new(raw(key), "%s%s." % [_where, key], errors)


## A list of objects.
func parts(key: String, low: int, high: int) -> Array[LudusPolicyFields]:
	var value: Variant = raw(key)
	var found: Array[LudusPolicyFields] = []
	if value is not Array or len(value) < low or len(value) > high:
		fail(key, "expected %d to %d items, got %s" % [low, high, _short(value)])
		return found
	for i: int in len(value):
		found.append(LudusPolicyFields.new(value[i], "%s%s[%d]." % [_where, key, i], errors))
	return found


## The shape of an array.
func shape(key: String) -> PackedInt32Array:
	return part(key).sizes("shape", 4)


## The numbers of an array of [param expected] shape, where -1 stands for any size from 1 on.
func tensor(key: String, expected: PackedInt32Array) -> PackedFloat32Array:
	var found := shape(key)
	var fits := found.size() == expected.size()
	for i: int in mini(found.size(), expected.size()):
		fits = fits and (found[i] == expected[i] or (expected[i] < 0 and found[i] > 0))
	if not fits:
		fail(key + ".shape", "expected %s, got %s" % [_shape_text(expected), _shape_text(found)])
		return PackedFloat32Array()
	var count := 1
	for size: int in found:
		count *= size
	return part(key)._decode(count)


func _decode(count: int) -> PackedFloat32Array:
	var data := text("data")
	var bytes := PackedByteArray()
	# The engine complains about texts of other lengths on its own.
	if not data.is_empty() and data.length() % 4 == 0:
		bytes = Marshalls.base64_to_raw(data)
	if bytes.size() != count * 4:
		fail("data", "expected %d bytes in base64, got %d" % [count * 4, bytes.size()])
		return PackedFloat32Array()
	var found := bytes.to_float32_array()
	for i: int in count:
		if not is_finite(found[i]):
			fail("data", "number %d is not finite" % i)
			return PackedFloat32Array()
	return found


func _finite(key: String, value: Variant) -> float:
	if (value is float or value is int) and is_finite(value):
		return value
	fail(key, "expected a finite number, got %s" % _short(value))
	return 0.0


static func _short(value: Variant) -> String:
	return JSON.stringify(value).left(60)


static func _shape_text(shown: PackedInt32Array) -> String:
	var words := PackedStringArray()
	for size: int in shown:
		words.append(str(size) if size >= 0 else "any")
	return "[%s]" % ", ".join(words)
