class_name LudusCall
extends RefCounted
## One method call by name (PROTOCOL.md §8).

const CEILING_METHOD := "run_ceiling"

var _message: Dictionary = {}


func _init(payload: PackedByteArray) -> void:
	var message: Variant = LudusWire.read_json(payload)
	if message != null:
		_message = message


## Whether the add-on itself is asked to measure the ceiling.
func is_ceiling() -> bool:
	return bool(_target().get("bridge", false)) and _message.get("method") == CEILING_METHOD


## Starts that measurement.
func make_ceiling(game: LudusGame) -> LudusCeiling:
	var arguments := _arguments()
	var num_steps := int(arguments[0]) if arguments.size() > 0 else 1
	var seed_value := int(arguments[1]) if arguments.size() > 1 else 0
	return LudusCeiling.new(game, int(_message.get("id", 0)), num_steps, seed_value)


## Makes the call and returns the frame with its result.
func answer(game: LudusGame) -> PackedByteArray:
	var result := {"id": int(_message.get("id", 0))}
	var method := str(_message.get("method", ""))
	var node := game.find_target(_target())
	if node == null:
		result["error"] = "there is no world or agent %s" % JSON.stringify(_target())
	elif not node.has_method(method):
		result["error"] = "%s has no method %s" % [node.name, method]
	else:
		result["value"] = node.callv(method, _arguments())
	return LudusWire.json_frame(LudusWire.Type.RESULT, result)


func _target() -> Dictionary:
	var target: Variant = _message.get("target", {})
	return target if target is Dictionary else {}


func _arguments() -> Array:
	var arguments: Variant = _message.get("arguments", [])
	return arguments if arguments is Array else []
