class_name LudusJson
extends Reference
## Writes JSON with all digits: Godot 3 itself keeps six after the point.

const LARGEST_PLAIN := 1e15
const SMALLEST_PLAIN := 1e-3


## Writes a value of numbers, texts, arrays and dictionaries as JSON text.
static func write(value) -> String:
	match typeof(value):
		TYPE_DICTIONARY:
			return _write_object(value)
		TYPE_ARRAY, TYPE_INT_ARRAY, TYPE_REAL_ARRAY, TYPE_STRING_ARRAY, TYPE_RAW_ARRAY:
			return _write_list(value)
		TYPE_REAL:
			return _write_number(value)
	return JSON.print(value)


static func _write_object(object: Dictionary) -> String:
	var parts := PoolStringArray()
	for key in object:
		parts.append("%s:%s" % [JSON.print(str(key)), write(object[key])])
	return "{%s}" % parts.join(",")


static func _write_list(list) -> String:
	var parts := PoolStringArray()
	for item in list:
		parts.append(write(item))
	return "[%s]" % parts.join(",")


## JSON has no infinity and no NaN.
static func _write_number(number: float) -> String:
	if is_inf(number) or is_nan(number):
		return "null"
	var size := abs(number)
	if number == floor(number) and size < LARGEST_PLAIN:
		return "%d" % int(number)
	if size >= SMALLEST_PLAIN and size < LARGEST_PLAIN:
		return ("%.16f" % number).rstrip("0")
	var exponent := int(floor(log(size) / log(10.0)))
	# In two halves, because ten to the power of 320 is no float.
	var half := exponent / 2
	var mantissa := number / pow(10.0, half) / pow(10.0, exponent - half)
	return "%se%d" % [("%.16f" % mantissa).rstrip("0").trim_suffix("."), exponent]
