class_name LudusCall
extends Reference
## One method call by name (PROTOCOL.md §8).

const CEILING_METHOD := "run_ceiling"
const TAKE_REQUESTS_METHOD := "take_requests"
const SHOW_STATUS_METHOD := "show_status"

var _message: Dictionary = {}


func _init(payload: PoolByteArray) -> void:
	var message = LudusWire.read_json(payload)
	if message != null:
		_message = message


## Whether the add-on itself is asked to measure the ceiling.
func is_ceiling() -> bool:
	return is_for_bridge() and _method() == CEILING_METHOD


## Whether the add-on itself is called.
func is_for_bridge() -> bool:
	var bridge = _target().get("bridge")
	return bridge is bool and bridge


## Calls a method of the add-on and returns the frame with its result.
func answer_for_bridge(requests: LudusRequests, status: LudusTrainingStatus) -> PoolByteArray:
	var result := {"id": int(_message.get("id", 0))}
	var arguments := _arguments()
	var method := _method()
	if method == TAKE_REQUESTS_METHOD:
		result["value"] = requests.take()
	elif method != SHOW_STATUS_METHOD:
		result["error"] = "the add-on has no method %s" % method
	elif arguments.size() != 1 or not arguments[0] is Dictionary:
		result["error"] = "%s takes one object" % method
	else:
		status.take_in(arguments[0])
		result["value"] = null
	return LudusWire.json_frame(LudusWire.Type.RESULT, result)


## Starts that measurement.
func make_ceiling(game: LudusGame) -> LudusCeiling:
	var arguments := _arguments()
	var num_steps := int(arguments[0]) if arguments.size() > 0 else 1
	var seed_value := int(arguments[1]) if arguments.size() > 1 else 0
	return LudusCeiling.new(game, int(_message.get("id", 0)), num_steps, seed_value)


## Makes the call and returns the frame with its result.
func answer(game: LudusGame) -> PoolByteArray:
	var result := {"id": int(_message.get("id", 0))}
	var method := _method()
	var callee := game.find_target(_target())
	if callee == null:
		result["error"] = "there is no world or agent %s" % LudusJson.write(_target())
	elif not callee.has_method(method):
		result["error"] = "%s has no method %s" % [_name_of(callee), method]
	else:
		result["value"] = callee.callv(method, _arguments())
	return LudusWire.json_frame(LudusWire.Type.RESULT, result)


static func _name_of(callee: Object) -> String:
	return callee.name if callee is Node else callee.get_script().resource_path


func _method() -> String:
	return str(_message.get("method", ""))


func _target() -> Dictionary:
	var target = _message.get("target", {})
	return target if target is Dictionary else {}


func _arguments() -> Array:
	var arguments = _message.get("arguments", [])
	return arguments if arguments is Array else []
