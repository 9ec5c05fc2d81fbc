extends Reference
## A client's request, taken apart and checked. No input or output happens here.
##
## [code]{"config": {"agent": {…}, "world": {…}, "environment": {"repeat_action": 4, "time_speed":
## 1.0}}, "reset": 1, "action": …, "observation": {"agent": …, "world": …}}[/code], each of them
## only where it is wanted.

const KEYS := {"config": true, "reset": true, "action": true, "observation": true}
const PARTS := ["agent", "world", "environment"]
const MAX_REPEAT_ACTION := 1000000
const MIN_TIME_SPEED := 0.02
const MAX_TIME_SPEED := 1000.0
## Godot's parser calls itself for each level; some ten thousand levels end the process.
const MAX_DEPTH := 1000
const NUM_SHOWN := 60

## What was asked; empty after an error.
var content: Dictionary = {}
## What is wrong; empty if nothing is.
var error: String = ""
## Keys that mean nothing; they do no harm.
var unknown_keys: Array = []


## Reads the text of a request. The object is used again for the next one: to make another would
## take as long as the checks.
func read(text: String) -> void:
	content = {}
	error = _nesting_error(text) if text.length() > MAX_DEPTH else ""
	if not error.empty():
		return
	var parsed := JSON.parse(text)
	if parsed.error != OK or not parsed.result is Dictionary:
		error = "a request must be a JSON object, this came: %s" % _shown(text)
		return
	_check(parsed.result, text)
	if error.empty():
		content = parsed.result


func _check(request: Dictionary, text: String) -> void:
	if not KEYS.has_all(request.keys()):
		unknown_keys = _unknown_keys(request)
	elif not unknown_keys.empty():
		unknown_keys = []
	if unknown_keys.size() == request.size():
		error = "a request needs one of %s, this came: %s" % [KEYS.keys(), _shown(text)]
	elif request.has("observation") and not request["observation"] is Dictionary:
		error = 'observation must be an object such as {"agent": []}'
	elif request.has("config"):
		_check_configuration(request["config"])


static func _unknown_keys(request: Dictionary) -> Array:
	var unknown := []
	for key in request:
		if not KEYS.has(key):
			unknown.append(key)
	return unknown


func _check_configuration(config) -> void:
	if not config is Dictionary:
		error = 'config must be an object such as {"environment": {"repeat_action": 4}}'
		return
	for part in PARTS:
		if config.has(part) and not config[part] is Dictionary:
			error = "config.%s must be an object" % part
			return
	var environment: Dictionary = config.get("environment", {})
	_check_number(environment, "repeat_action", 1.0, MAX_REPEAT_ACTION)
	_check_number(environment, "time_speed", MIN_TIME_SPEED, MAX_TIME_SPEED)
	if error.empty() and environment.has("repeat_action"):
		_check_is_whole(environment["repeat_action"])


func _check_number(config: Dictionary, key: String, smallest: float, largest: float) -> void:
	if not error.empty() or not config.has(key):
		return
	var value = config[key]
	# A number that is not finite is not between two others.
	if not value is float or not (value >= smallest and value <= largest):
		var where := "config.environment.%s" % key
		error = "%s must be a number from %s to %s" % [where, smallest, largest]


func _check_is_whole(value: float) -> void:
	if value != floor(value):
		error = "config.environment.repeat_action must be a whole number"


static func _nesting_error(text: String) -> String:
	if _has_many(text, "[") or _has_many(text, "{"):
		if _is_too_deep(text):
			return "a request is nested more than %d deep" % MAX_DEPTH
	return ""


## Tells whether a text may be too deep because of one kind of bracket. Godot's [code]count()[/code]
## copies the rest of the text at each hit: 200,000 brackets would keep it busy for seconds.
static func _has_many(text: String, opening: String) -> bool:
	var at := text.find(opening)
	var count := 0
	while at >= 0 and count <= MAX_DEPTH / 2:
		count += 1
		at = text.find(opening, at + 1)
	return count > MAX_DEPTH / 2


static func _is_too_deep(text: String) -> bool:
	var depth := 0
	var is_quoted := false
	var is_escaped := false
	for character in text:
		if is_quoted:
			is_quoted = is_escaped or character != '"'
			is_escaped = character == "\\" and not is_escaped
		elif character == '"':
			is_quoted = true
		elif character == "[" or character == "{":
			depth += 1
			if depth > MAX_DEPTH:
				return true
		elif character == "]" or character == "}":
			depth -= 1
	return false


static func _shown(text: String) -> String:
	return text if text.length() <= NUM_SHOWN else text.left(NUM_SHOWN) + "…"
