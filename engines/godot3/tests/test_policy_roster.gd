extends "policy_test.gd"
## Which agents a policy plays: they come and go, and some it does not fit.


func test_agents_with_one_policy_are_computed_together() -> void:
	var golden := _golden("perceptron_relu")
	var _three := _agents(golden, 3)
	var other: StubAgent = _agents(_golden("perceptron_elu"), 1)[0]
	other.policy_name = "other"
	var player := _player()
	_advance(player, 1)
	equal(player.get("_groups").size(), 2, "groups")


func test_newcomers_join_as_they_are() -> void:
	var golden := _golden("perceptron_tanh")
	var first := _agents(golden, 1)
	var _first := _in_one_world(first)
	var player := _player()
	_advance(player, 1)
	var newcomer := _agents(golden, 1)
	var _newcomer := _in_one_world(newcomer, first[0].world)
	_advance(player, 1)
	equal(newcomer[0].applied.size(), 0, "it waits for the next decision")
	_advance(player, 1)
	equal(newcomer[0].applied.size(), 1, "it acts")
	equal(newcomer[0].num_resets, 0, "resets")


func test_agents_that_come_as_the_first_episode_begins() -> void:
	var golden := _golden("perceptron_tanh")
	var first: StubAgent = _in_one_world(_agents(golden, 1))[0]
	var came := []
	var binds := [golden, first.world, came]
	equal(first.world.connect("episode_started", self, "_bring_agent", binds), OK, "connect")
	_advance(_player(), 3)
	equal(came.size(), 1, "agents that came")
	equal(came[0].applied.size(), 1, "it acts")
	equal(came[0].num_resets, 0, "and is not reset")


func test_an_agent_that_leaves() -> void:
	var golden := _golden("perceptron_tanh")
	var agents := _agents(golden, 2)
	var player := _player()
	_advance(player, 3)
	agents[0].free()
	_advance(player, 2)
	equal(_ended, [["stub", 0, 0.0, 2]], "what has ended")
	equal(agents[1].applied.size(), 5, "the other plays on")
	var next: StubAgent = _agents(golden, 1)[0]
	_advance(player, 2)
	equal(next.num_resets, 1, "one that comes begins in a world of its own")
	var group: LudusPolicyGroup = player.get("_groups")[0]
	equal(group.batch.agents.size(), 2, "and gets the free slot")


func test_a_scene_that_is_left_while_it_settles() -> void:
	var golden := _golden("perceptron_tanh")
	var first: StubAgent = _in_one_world(_agents(golden, 1))[0]
	first.world.settle_ticks = 4
	var player := _player()
	_advance(player, 2)
	first.world.root.free()
	var next: StubAgent = _agents(golden, 1)[0]
	_advance(player, 9)
	equal(next.applied.size(), 9, "the agent of the next scene acts")
	var group: LudusPolicyGroup = player.get("_groups")[0]
	equal(Array(group.batch.active), [0, 1], "only that one plays")


func test_agents_are_switched_off_and_on() -> void:
	var agent: StubAgent = _agents(_golden("perceptron_tanh"), 1)[0]
	var player := _player()
	_advance(player, 2)
	agent.enabled = false
	_advance(player, 4)
	equal(agent.applied.size(), 2, "it stops")
	agent.enabled = true
	_advance(player, 2)
	equal(agent.applied.size(), 4, "it goes on")
	agent.policy = null
	_advance(player, 2)
	equal(agent.applied.size(), 4, "without a policy it stops")
	equal(_ended.size(), 0, "ends")


func test_a_policy_is_exchanged() -> void:
	var agent: StubAgent = _agents(_golden("perceptron_tanh"), 1)[0]
	var player := _player()
	_advance(player, 2)
	agent.policy = _golden("perceptron_relu").policy
	_advance(player, 2)
	equal(agent.applied.size(), 4, "actions")
	equal(player.get("_groups").size(), 2, "groups")
	equal(agent.num_resets, 1, "resets")


func test_a_wrong_observation_ends_the_play() -> void:
	var agent: StubAgent = _agents(_golden("perceptron_tanh"), 1)[0]
	var player := _player()
	_advance(player, 2)
	agent.seen = PoolRealArray([1.0])
	_advance(player, 1)
	_advance(player, 6)
	equal(agent.applied.size(), 3, "actions")
	equal(agent.episode_steps, 0, "it belongs to no batch")


func test_a_policy_that_does_not_fit() -> void:
	var agent: StubAgent = _agents(_golden("perceptron_tanh"), 1)[0]
	var mistakes: Array = [
		[["observation", "name", "rays"], 'observation["observation"]: the policy needs'],
		[["observation", "shape", PoolIntArray([4])], "trained on float32 [5], the agent has"],
		[["observation", "dtype", 1], "the agent has uint8 [5]"],
		[["action", "name", "pull"], 'action["push"]: the policy decides this component'],
		[["action", "n", 4], 'action["push"]: the policy chooses among 3, the agent has 4'],
		[["action", "kind", 1], 'action["push"]: the policy decides this component'],
	]
	for mistake in mistakes:
		var part: Resource = agent.get(mistake[0][0])[0]
		var right = part.get(mistake[0][1])
		part.set(mistake[0][1], mistake[0][2])
		var problem: String = agent.policy.incompatibility(agent)
		check(str(mistake[1]) in problem, "%s: %s" % [mistake[1], problem])
		var warnings := agent._get_configuration_warning()
		check("The policy does not fit: " + problem in warnings, warnings)
		part.set(mistake[0][1], right)
	equal(agent.policy.incompatibility(agent), "", "a policy that fits")
	agent.action.append(LudusActionComponent.new())
	check(
		"decides 1 action components, the agent has 2" in agent.policy.incompatibility(agent), "two"
	)
	_advance(_player(), 3)
	equal(agent.applied.size() + agent.num_resets, 0, "it is left alone")


func test_bounds_and_masks_must_fit() -> void:
	var squashed: StubAgent = _agents(_golden("squashed"), 1)[0]
	equal(squashed.policy.incompatibility(squashed), "", "right bounds")
	squashed.action[0].high = 3.0
	var found: String = squashed.policy.incompatibility(squashed)
	check("trained for -2" in found, found)
	squashed.action[0].size = 2
	check("decides 3 numbers" in squashed.policy.incompatibility(squashed), "size")
	var mixed: StubAgent = _agents(_golden("mixed"), 1)[0]
	equal(mixed.policy.incompatibility(mixed), "", "a policy with masks")
	mixed.has_action_mask = false
	check("get_action_mask()" in mixed.policy.incompatibility(mixed), "masks")


func test_entries_come_from_the_policy() -> void:
	var agent: StubAgent = _agents(_golden("perceptron_tanh"), 1)[0]
	agent.observation = []
	agent.seen = [1, 2, 3, 4, 5]
	_advance(_player(), 2)
	equal(agent.applied.size(), 2, "actions")
	equal(agent.num_resets, 1, "resets")


func test_people_leave_such_agents_alone() -> void:
	var agent: StubAgent = _agents(_golden("perceptron_tanh"), 1)[0]
	var manual := LudusManualPlay.new(tree)
	for _tick in 4:
		manual.advance()
	equal(agent.num_resets, 0, "resets")


func _bring_agent(golden: GoldenPolicy, world: LudusWorld, came: Array) -> void:
	came.append_array(_in_one_world(_agents(golden, 1), world))
