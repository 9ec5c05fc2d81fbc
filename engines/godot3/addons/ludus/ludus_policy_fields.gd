tool
class_name LudusPolicyFields
extends Reference
## Typed access to one JSON object of a policy file. Mistakes are noted with their place.

const MAX_ELEMENTS := 33554432

## What is wrong, one line each; shared by all parts of a file.
var errors: Array

var _object: Dictionary = {}
var _where: String = ""


func _init(value, where: String, noted: Array) -> void:
	errors = noted
	_where = where
	if value is Dictionary:
		_object = value
	else:
		var place := where.trim_suffix(".") if not where.empty() else "the whole"
		var type: String = LudusObservationEntry.TYPE_NAMES[typeof(value)]
		errors.append("%s: expected an object, got %s" % [place, type])


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
func raw(key: String):
	if not _object.has(key):
		fail(key, "missing")
	return _object.get(key)


## A text.
func text(key: String) -> String:
	var value = raw(key)
	if value is String:
		return value
	fail(key, "expected a text, got %s" % _short(value))
	return ""


## A text out of some; returns its index.
func choice(key: String, choices: Array) -> int:
	var index := choices.find(text(key))
	if index < 0:
		var listed := PoolStringArray(choices).join(", ")
		fail(key, "expected one of %s, got %s" % [listed, _short(raw(key))])
		return 0
	return index


## True or false.
func flag(key: String) -> bool:
	var value = raw(key)
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
	if value != floor(value) or value < low or value > high:
		fail(key, "expected an integer from %d to %d, got %s" % [low, high, _short(raw(key))])
		return low
	return int(value)


## A list of numbers, or one number for all of [param count].
func numbers(key: String, count: int) -> Array:
	var value = raw(key)
	var found := []
	if not value is Array:
		found.resize(count)
		found.fill(_finite(key, value))
	elif value.size() != count:
		fail(key, "expected %d numbers, got %d" % [count, value.size()])
		found.resize(count)
		found.fill(0.0)
	else:
		for item in value:
			found.append(_finite(key, item))
	return found


## A list of sizes.
func sizes(key: String, max_count: int) -> Array:
	var value = raw(key)
	var found := []
	if not value is Array or value.size() < 1 or value.size() > max_count:
		fail(key, "expected 1 to %d sizes, got %s" % [max_count, _short(value)])
		return found
	var product := 1.0
	for item in value:
		var size := _finite(key, item)
		product *= size
		if size < 0 or size != floor(size) or product > MAX_ELEMENTS:
			fail(key, "expected sizes, got %s" % _short(value))
			return []
		found.append(int(size))
	return found


## An object inside this one: fields, too.
func part(key: String) -> Reference:
	# A class of Godot 3 cannot name itself.
	return get_script().new(raw(key), "%s%s." % [_where, key], errors)


## A list of objects.
func parts(key: String, low: int, high: int) -> Array:
	var value = raw(key)
	var found := []
	if not value is Array or value.size() < low or value.size() > high:
		fail(key, "expected %d to %d items, got %s" % [low, high, _short(value)])
		return found
	for i in value.size():
		found.append(get_script().new(value[i], "%s%s[%d]." % [_where, key, i], errors))
	return found


## The shape of an array.
func shape(key: String) -> Array:
	return part(key).sizes("shape", 4)


## The numbers of an array of [param expected] shape, where -1 stands for any size from 1 on.
func tensor(key: String, expected: Array) -> Array:
	var found := shape(key)
	var fits := found.size() == expected.size()
	for i in min(found.size(), expected.size()):
		fits = fits and (found[i] == expected[i] or (expected[i] < 0 and found[i] > 0))
	if not fits:
		fail(key + ".shape", "expected %s, got %s" % [_shape_text(expected), _shape_text(found)])
		return []
	var count := 1
	for size in found:
		count *= size
	return part(key)._decode(count)


func _decode(count: int) -> Array:
	var data := text("data")
	var bytes := PoolByteArray()
	# The engine complains about texts of other lengths on its own.
	if not data.empty() and data.length() % 4 == 0:
		bytes = Marshalls.base64_to_raw(data)
	if bytes.size() != count * 4:
		fail("data", "expected %d bytes in base64, got %d" % [count * 4, bytes.size()])
		return []
	var found := Array(LudusWire.read_floats(bytes, 0, count))
	for i in count:
		if is_nan(found[i]) or is_inf(found[i]):
			fail("data", "number %d is not finite" % i)
			return []
	return found


func _finite(key: String, value) -> float:
	if (value is float or value is int) and not (is_nan(value) or is_inf(value)):
		return value
	fail(key, "expected a finite number, got %s" % _short(value))
	return 0.0


static func _short(value) -> String:
	return LudusJson.write(value).left(60)


static func _shape_text(shown: Array) -> String:
	var words := PoolStringArray()
	for size in shown:
		words.append(str(size) if size >= 0 else "any")
	return "[%s]" % words.join(", ")
