extends "ludus_test.gd"
## Mistakes in a scene are told by the agent, in the editor and to the trainer.

const LudusRegistry := preload("res://addons/ludus/bridge/registry.gd")
const StubAgent := preload("stub_agent.gd")

const GAME := """
extends Node
func apply_action(_action: int) -> void: pass
func get_observation() -> Array: return [0.0]
func get_reward() -> float: return 0.0
func is_done() -> bool: return false
func reset() -> void: pass
"""


func test_a_right_agent() -> void:
	var agent := _agent(_script(GAME))
	_check_warnings(agent, [])
	equal(agent.connect_to_game(), "", "connect_to_game")
	check(agent.target == agent.get_parent(), "the target is the parent")


func test_an_agent_that_is_its_own_game() -> void:
	var agent := StubAgent.new()
	agent.action = [LudusActionComponent.new()]
	add(agent)
	_check_warnings(agent, [])
	equal(agent.connect_to_game(), "", "connect_to_game")
	check(agent.target == agent, "the target is the agent")


func test_inherited_methods_count() -> void:
	var child := _script("extends Node")
	child.source_code = GAME.replace("extends Node", "extends Node\nvar x := 1")
	child.reload()
	_check_warnings(_agent(child), [])


func test_a_stub_of_a_controller_counts_as_missing() -> void:
	var whole := GAME.replace("extends Node", "extends LudusController2D")
	equal(_agent(_script(whole)).connect_to_game(), "", "all five are overridden")
	for method: StringName in LudusAgent.REQUIRED_METHODS:
		var agent := _agent(_script(whole.replace("func %s(" % method, "func other(")))
		_check_warnings(agent, ["The target has no method %s()" % method])
		check("has no method %s()" % method in agent.connect_to_game(), "connect_to_game")


func test_optional_methods_of_a_controller_count_where_overridden() -> void:
	var game := GAME.replace("extends Node", "extends LudusController3D")
	var without := _agent(_script(game + "func get_action_masks() -> Array: return []"))
	equal(without.connect_to_game(), "", "connect_to_game")
	check(not (without.has_mask() or without.has_truncation()), "stubs do not count")
	check(not without.has_manual_action(), "nor does that of a person")
	_check_warnings(without, ["did you mean get_action_mask()"])
	var optional := """
func get_action_mask() -> PackedByteArray: return [1, 0]
func is_truncated() -> bool: return true
func get_manual_action() -> int: return 1
"""
	var with := _agent(_script(game + optional))
	equal(with.connect_to_game(), "", "connect_to_game")
	check(with.has_mask() and with.has_truncation() and with.has_manual_action(), "all count")
	var rng := (with.target as LudusController3D).world.rng
	check(rng == LudusWorld.find_above(with.target).rng, "its randomness is that of the world")


func test_no_policy_name() -> void:
	var agent := _agent(_script(GAME))
	agent.policy_name = ""
	_check_warnings(agent, ["policy_name is empty"])


func test_no_action() -> void:
	var agent := _agent(_script(GAME))
	agent.action = []
	_check_warnings(agent, ["No action is declared"])
	check("no action is declared" in agent.connect_to_game(), "connect_to_game")


func test_an_empty_item() -> void:
	var agent := _agent(_script(GAME))
	agent.action.append(null)
	_check_warnings(agent, ["empty item"])
	agent.action.pop_back()
	agent.observation.append(null)
	_check_warnings(agent, ["empty item"])


func test_an_invalid_component() -> void:
	var agent := _agent(_script(GAME))
	agent.action[0] = LudusActionComponent.continuous("move", 1, 2.0, -2.0)
	_check_warnings(agent, ["Action move: low must be below high"])


func test_a_target_that_is_not_there() -> void:
	var agent := _agent(_script(GAME))
	agent.target_path = ^"../Nobody"
	_check_warnings(agent, ["target_path leads nowhere"])
	equal(agent.connect_to_game(), "target_path ../Nobody leads nowhere", "connect_to_game")


func test_a_target_without_a_script() -> void:
	var agent := _agent(null)
	_check_warnings(agent, ["has no script with the five methods"])
	check("has no method apply_action()" in agent.connect_to_game(), "connect_to_game")


func test_missing_methods() -> void:
	for method: StringName in LudusAgent.REQUIRED_METHODS:
		var agent := _agent(_script(GAME.replace("func %s(" % method, "func other(")))
		_check_warnings(agent, ["The target has no method %s()" % method])
		check("has no method %s()" % method in agent.connect_to_game(), "connect_to_game")


func test_a_mask_without_its_method() -> void:
	var agent := _agent(_script(GAME))
	agent.has_action_mask = true
	check("get_action_mask()" in agent.connect_to_game(), "connect_to_game")
	_check_warnings(agent, ["get_action_mask()"])


func test_a_mask_is_found_by_its_method() -> void:
	var agent := _agent(
		_script(GAME + "func get_action_mask() -> Array: return PackedByteArray([1, 0])")
	)
	equal(agent.connect_to_game(), "", "connect_to_game")
	check(agent.has_action_mask, "has_action_mask")
	_check_warnings(agent, [])


func test_scenes_may_have_the_former_name_of_sample_actions() -> void:
	var agent := StubAgent.new()
	agent.set("is_sampling", true)
	check(agent.sample_actions, "is_sampling")
	agent.free()


func test_agents_that_come_and_go_leave_nothing_behind() -> void:
	var root := Node.new()
	add(root)
	LudusWorld.of(root)
	var num_before := LudusRegistry.agents.size()
	LudusRegistry.newcomers.clear()
	for i: int in 20:
		var agent := StubAgent.new()
		root.add_child(agent)
		check(LudusRegistry.newcomers.has(agent), "it is new")
		agent.free()
	equal(LudusRegistry.newcomers.size(), 0, "newcomers")
	equal(LudusRegistry.agents.size(), num_before, "agents")


func _script(code: String) -> GDScript:
	var script := GDScript.new()
	script.source_code = code
	script.reload()
	return script


func _agent(script: GDScript) -> LudusAgent:
	var root: Node = Node.new() if script == null else script.new()
	var agent := LudusAgent.new()
	agent.action = [LudusActionComponent.new()]
	root.add_child(agent)
	add(root)
	return agent


func _check_warnings(agent: LudusAgent, expected: Array[String]) -> void:
	var warnings := agent._get_configuration_warnings()
	equal(warnings.size(), expected.size(), "number of warnings (%s)" % "; ".join(warnings))
	for i: int in mini(warnings.size(), expected.size()):
		check(expected[i] in warnings[i], "%s: %s" % [expected[i], warnings[i]])
