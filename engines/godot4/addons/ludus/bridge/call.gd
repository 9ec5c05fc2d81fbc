extends RefCounted
## One method call by name (PROTOCOL.md §8).

const LudusCeiling := preload("res://addons/ludus/bridge/ceiling.gd")
const LudusPicture := preload("res://addons/ludus/cameras/picture.gd")
const LudusGame := preload("res://addons/ludus/world/game.gd")
const LudusRegistry := preload("res://addons/ludus/bridge/registry.gd")
const LudusMetrics := preload("res://addons/ludus/bridge/metrics.gd")
const LudusRequests := preload("res://addons/ludus/bridge/requests.gd")
const LudusWire := preload("res://addons/ludus/bridge/wire.gd")

const CEILING_METHOD := "run_ceiling"
const TAKE_REQUESTS_METHOD := "take_requests"
const SHOW_STATUS_METHOD := "show_status"
const SHOW_DECISION_METHOD := "show_decision"
const STAND_BY_METHOD := "stand_by"
const PASS_FRAME_METHOD := "pass_frame"
const PICTURE_METHOD := "picture"
## Methods of an agent that Ludus itself calls.
const AGENT_METHODS: PackedStringArray = ["get_manual_action"]
## Methods of the game whose names begin so may be called.
const PREFIX := "ludus_"

var _message: Dictionary = {}


func _init(payload: PackedByteArray) -> void:
	var message: Variant = LudusWire.read_json(payload)
	if message != null:
		_message = message


## Whether the add-on itself is asked to measure the ceiling.
func is_ceiling() -> bool:
	return is_for_bridge() and _method() == CEILING_METHOD


## Whether the game is told to go on by itself.
func is_stand_by() -> bool:
	return is_for_bridge() and _method() == STAND_BY_METHOD


## Whether a person is to have a frame in which to choose.
func is_frame_passed() -> bool:
	return is_for_bridge() and _method() == PASS_FRAME_METHOD


## The answer to a call that has nothing to return.
func answer_nothing() -> PackedByteArray:
	var result := {"id": _id(), "value": null}
	return LudusWire.json_frame(LudusWire.Type.RESULT, result)


## Whether the add-on itself is called.
func is_for_bridge() -> bool:
	return is_same(_target().get("bridge"), true)


## Calls a method of the add-on and returns the frame with its result.
func answer_for_bridge(requests: LudusRequests, metrics: LudusMetrics) -> PackedByteArray:
	var result := {"id": _id()}
	var arguments := _arguments()
	var method := _method()
	if method == TAKE_REQUESTS_METHOD:
		result["value"] = requests.take() + metrics.take()
	elif method not in [SHOW_STATUS_METHOD, SHOW_DECISION_METHOD]:
		result["error"] = "the add-on has no method %s" % method
	elif arguments.size() != 1 or arguments[0] is not Dictionary:
		result["error"] = "%s takes one object" % method
	elif method == SHOW_DECISION_METHOD:
		if LudusRegistry.debug_view != null:
			LudusRegistry.debug_view.take_decision(arguments[0])
		result["value"] = null
	else:
		requests.take_in(arguments[0])
		result["value"] = true if requests.flags() != 0 else null
	return LudusWire.json_frame(LudusWire.Type.RESULT, result)


## Starts that measurement.
func make_ceiling(game: LudusGame) -> LudusCeiling:
	var arguments := _arguments()
	var num_steps := _integer(arguments[0], 1) if arguments.size() > 0 else 1
	var seed_value := _integer(arguments[1], 0) if arguments.size() > 1 else 0
	return LudusCeiling.new(game, _id(), num_steps, seed_value)


## Makes the call and returns the frame with its result.
func answer(game: LudusGame) -> PackedByteArray:
	var result := {"id": _id()}
	var method := _method()
	var callee := game.find_target(_target())
	if callee == null:
		result["error"] = "there is no world or agent %s" % JSON.stringify(_target())
	elif method == PICTURE_METHOD and not callee.has_method(method):
		var world := game.find_world(_target())
		var problem := LudusPicture.find_problem(world)
		if problem.is_empty():
			result["value"] = LudusPicture.of(world, game.neighbours_of(world))
		else:
			result["error"] = problem
	elif not callee.has_method(method):
		result["error"] = "%s has no method %s" % [_name_of(callee), method]
	elif not _is_reachable(method, game.find_world(_target())):
		result["error"] = (
			(
				"%s does not let trainers call %s: begin its name with %s, or add it to "
				+ "LudusWorld.callable_methods"
			)
			% [_name_of(callee), method, PREFIX]
		)
	else:
		result["value"] = callee.callv(method, _arguments())
	return LudusWire.json_frame(LudusWire.Type.RESULT, result)


## Whether the game lets trainers call a method, so that a connection is not a way to all of Godot.
static func _is_reachable(method: String, world: LudusWorld) -> bool:
	return method.begins_with(PREFIX) or method in AGENT_METHODS or method in world.callable_methods


static func _name_of(callee: Object) -> String:
	if callee is Node:
		return str((callee as Node).name)
	return (callee.get_script() as Script).resource_path


func _id() -> int:
	return _integer(_message.get("id"), 0)


func _method() -> String:
	return str(_message.get("method", ""))


static func _integer(value: Variant, default: int) -> int:
	return int(value) if value is float or value is int else default


func _target() -> Dictionary:
	var target: Variant = _message.get("target", {})
	return target if target is Dictionary else {}


func _arguments() -> Array:
	var arguments: Variant = _message.get("arguments", [])
	return arguments if arguments is Array else []
