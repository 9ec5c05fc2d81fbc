extends "res://addons/ludus_gdrl/gdrl_agent.gd"
## An agent whose AIController can record expert demonstrations, so that a person can play it.
##
## Such a controller reads the keys in [code]set_action()[/code] without an argument, and says in
## [code]get_action()[/code] what they were.

const HEURISTIC := "demo_record"


## Whether a controller can record demonstrations: the game has written its own
## [code]get_action()[/code], and a [code]set_action()[/code] that needs no argument.
static func suits(controller: Node) -> bool:
	var script: Script = controller.get_script()
	var methods := script.get_script_method_list()
	var names: Array = methods.map(func(method: Dictionary) -> String: return method["name"])
	var original := script
	while original.get_base_script() != null:
		original = original.get_base_script()
	var num_stubs := 0
	if original != script:
		for stub: Dictionary in original.get_script_method_list():
			num_stubs += int(stub["name"] == "get_action")
	if names.count("get_action") == num_stubs:
		return false
	var setter: Dictionary = methods[names.find("set_action")]
	return (setter["args"] as Array).size() == (setter["default_args"] as Array).size()


## What the person decides now, as the trainer expects it.
func get_manual_action() -> Variant:
	_controller.call(&"set_heuristic", HEURISTIC)
	_controller.call(&"set_action")
	var said: Array = _controller.call(&"get_action")
	var num_choices := 0
	var named := {}
	var next := 0
	for part: LudusActionComponent in action:
		var is_choice := part.kind == LudusActionComponent.Kind.DISCRETE
		num_choices += int(is_choice)
		var size := 1 if is_choice else part.size
		var values := said.slice(next, next + size)
		named[part.name] = int(values[0]) if is_choice and values.size() == 1 else values
		next += size
	return said if next != said.size() or num_choices in [0, action.size()] else named
