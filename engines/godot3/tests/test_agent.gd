extends "ludus_test.gd"
## Mistakes in a scene are told by the agent, in the editor and to the trainer.

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
	equal(agent._get_configuration_warning(), "", "warning")
	equal(agent.connect_to_game(), "", "connect_to_game")
	check(agent.target == agent.get_parent(), "the target is the parent")


func test_an_agent_that_is_its_own_game() -> void:
	var agent := StubAgent.new()
	agent.action = [LudusActionComponent.new()]
	add(agent)
	equal(agent._get_configuration_warning(), "", "warning")
	equal(agent.connect_to_game(), "", "connect_to_game")
	check(agent.target == agent, "the target is the agent")


func test_no_policy_name() -> void:
	var agent := _agent(_script(GAME))
	agent.policy_name = ""
	_check_warning(agent, "policy_name is empty")


func test_no_action() -> void:
	var agent := _agent(_script(GAME))
	agent.action = []
	_check_warning(agent, "No action is declared")
	check("no action is declared" in agent.connect_to_game(), "connect_to_game")


func test_an_item_of_another_kind() -> void:
	for item in [null, Resource.new(), LudusObservationEntry.new()]:
		var agent := _agent(_script(GAME))
		agent.action.append(item)
		_check_warning(agent, "an item that is empty or of another kind")
		check("of another kind" in agent.connect_to_game(), "connect_to_game")
	var played := _agent(_script(GAME))
	played.policy = Resource.new()
	_check_warning(played, "an item that is empty or of another kind")
	check("of another kind" in played.connect_to_game(), "connect_to_game")


func test_an_invalid_component() -> void:
	var agent := _agent(_script(GAME))
	agent.action[0] = LudusActionComponent.continuous("move", 1, 2.0, -2.0)
	_check_warning(agent, "Action move: low must be below high")


func test_a_target_that_is_not_there() -> void:
	var agent := _agent(_script(GAME))
	agent.target_path = NodePath("../Nobody")
	_check_warning(agent, "target_path leads nowhere")
	equal(agent.connect_to_game(), "target_path ../Nobody leads nowhere", "connect_to_game")


func test_a_target_without_a_script() -> void:
	var agent := _agent(null)
	_check_warning(agent, "has no script with the five methods")
	check("has no method apply_action()" in agent.connect_to_game(), "connect_to_game")


func test_missing_methods() -> void:
	for method in LudusAgent.REQUIRED_METHODS:
		var agent := _agent(_script(GAME.replace("func %s(" % method, "func other(")))
		_check_warning(agent, "The target has no method %s()" % method)
		check("has no method %s()" % method in agent.connect_to_game(), "connect_to_game")


func test_a_mask_without_its_method() -> void:
	var agent := _agent(_script(GAME))
	agent.has_action_mask = true
	check("get_action_mask()" in agent.connect_to_game(), "connect_to_game")
	_check_warning(agent, "get_action_mask()")


func test_a_mask_is_found_by_its_method() -> void:
	var code := GAME + "func get_action_mask() -> PoolByteArray: return PoolByteArray([1, 0])"
	var agent := _agent(_script(code))
	check(agent.has_mask(), "has_mask")
	equal(agent.connect_to_game(), "", "connect_to_game")
	check(agent.has_action_mask, "has_action_mask")
	equal(agent._get_configuration_warning(), "", "warning")
	check(not _agent(_script(GAME)).has_mask(), "a game without the method")


func test_scenes_may_have_the_former_name_of_sample_actions() -> void:
	var agent := StubAgent.new()
	agent.set("is_sampling", true)
	check(agent.sample_actions, "is_sampling")
	agent.free()


func test_agents_that_come_and_go_leave_nothing_behind() -> void:
	var root := Node.new()
	add(root)
	var world := LudusWorld.of(root)
	for i in 20:
		var agent := StubAgent.new()
		root.add_child(agent)
		agent.free()
	equal(world.newcomers.size(), 0, "newcomers")


func _script(code: String) -> GDScript:
	var script := GDScript.new()
	script.source_code = code
	check(script.reload() == OK, "the script of a test")
	return script


func _agent(script: GDScript) -> LudusAgent:
	var root := Node.new()
	root.set_script(script)
	var agent := LudusAgent.new()
	agent.action = [LudusActionComponent.new()]
	root.add_child(agent)
	add(root)
	return agent


func _check_warning(agent: LudusAgent, expected: String) -> void:
	var warning := agent._get_configuration_warning()
	check(expected in warning and not "\n" in warning, "%s: %s" % [expected, warning])
