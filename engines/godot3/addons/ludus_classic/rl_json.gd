extends Reference
## Writes answers as JSON with all the digits of a number: Godot 3 itself keeps six after the point.
##
## Bytes become [code]{"$bytes": "…"}[/code] in base 64, vectors and colours lists of numbers, NaN
## and infinity [code]nan[/code] and [code]inf[/code], so that the reader can say where they stand.

const LARGEST_PLAIN := 1e15
const SMALLEST_PLAIN := 1e-3
const PLAIN := "%.16f"


## Writes a value as JSON text.
static func write(value) -> String:
	if value is float:
		return _write_number(value)
	if value is int:
		return str(value)
	if value is Dictionary:
		return _write_object(value)
	match typeof(value):
		TYPE_ARRAY, TYPE_REAL_ARRAY, TYPE_INT_ARRAY, TYPE_STRING_ARRAY:
			return _write_list(Array(value))
		TYPE_VECTOR2_ARRAY, TYPE_VECTOR3_ARRAY, TYPE_COLOR_ARRAY:
			return _write_list(Array(value))
		TYPE_RAW_ARRAY:
			return '{"$bytes":"%s"}' % Marshalls.raw_to_base64(value)
		TYPE_VECTOR2:
			return _write_list([value.x, value.y])
		TYPE_VECTOR3:
			return _write_list([value.x, value.y, value.z])
		TYPE_QUAT:
			return _write_list([value.x, value.y, value.z, value.w])
		TYPE_COLOR:
			return _write_list([value.r, value.g, value.b, value.a])
	return JSON.print(value)


static func _write_object(object: Dictionary) -> String:
	var parts := PoolStringArray()
	for key in object:
		var name := str(key)
		var is_simple := name.is_valid_identifier()  # cheaper than to escape it
		var text := name if is_simple else name.json_escape()
		parts.append('"' + text + '":' + write(object[key]))
	return "{%s}" % parts.join(",")


static func _write_list(list: Array) -> String:
	if _is_plain(list):
		return ("[%s]" % (PLAIN + ",").repeat(list.size()).trim_suffix(",")) % list
	var parts := PoolStringArray()
	for item in list:
		parts.append(write(item))
	return "[%s]" % parts.join(",")


## Whether one call can write all items: floats of a usual size. Most observations are.
static func _is_plain(list: Array) -> bool:
	for item in list:
		if not item is float:
			return false
		# NaN is not larger than anything.
		if item != 0.0 and not (abs(item) >= SMALLEST_PLAIN and abs(item) < LARGEST_PLAIN):
			return false
	return not list.empty()


static func _write_number(number: float) -> String:
	var size := abs(number)
	if number == 0.0 or (size >= SMALLEST_PLAIN and size < LARGEST_PLAIN):
		return PLAIN % number
	if is_inf(number) or is_nan(number):
		return str(number)
	var exponent := int(floor(log(size) / log(10.0)))
	# In two halves, because ten to the power of 320 is no float.
	var half := exponent / 2
	var mantissa := number / pow(10.0, half) / pow(10.0, exponent - half)
	return "%se%d" % [(PLAIN % mantissa).rstrip("0").trim_suffix("."), exponent]
