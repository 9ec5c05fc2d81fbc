extends "policy_test.gd"
## A policy plays agents by the rules of training.


func test_actions_are_those_of_the_policy() -> void:
	var golden := _golden("perceptron_tanh")
	var agents := _agents(golden, golden.num_agents)
	var player := _player()
	for step in golden.steps.size():
		var case: Dictionary = golden.steps[step]
		for i in agents.size():
			agents[i].seen = PoolRealArray(case["observation"]["observation"][i])
		_advance(player, 2)
		for i in agents.size():
			equal(agents[i].applied[-1], int(case["discrete"][i][0]), "step %d" % step)


func test_mixed_actions_arrive_by_name() -> void:
	var golden := _golden("mixed")
	var agent: StubAgent = _agents(golden, 1)[0]
	var case: Dictionary = golden.steps[0]
	agent.mask = PoolByteArray(case["action_mask"][0])
	agent.seen = {}
	for name in case["observation"]:
		agent.seen[name] = case["observation"][name][0]
	_advance(_player(), 1)
	var action: Dictionary = agent.applied[0]
	equal(action["gait"], int(case["discrete"][0][0]), "gait")
	equal(action["shoot"], int(case["discrete"][0][1]), "shoot")
	var aim: PoolRealArray = action["aim"]
	check(abs(aim[1] - float(case["continuous"][0][1])) < 1e-3, "aim is %s" % aim)


func test_images_are_seen() -> void:
	var golden := _golden("camera")
	var agents := _agents(golden, golden.num_agents)
	var case: Dictionary = golden.steps[1]
	for i in agents.size():
		agents[i].seen = {}
		for name in case["observation"]:
			agents[i].seen[name] = case["observation"][name][i]
	_advance(_player(), 1)
	for i in agents.size():
		equal(agents[i].applied, [int(case["discrete"][i][0])], "agent %d" % i)


func test_decisions_and_repetitions() -> void:
	for timing in LudusAgent.ActionTiming.values():
		var agent: StubAgent = _agents(_golden("perceptron_tanh"), 1)[0]
		agent.action_timing = timing
		agent.ticks_per_step = 3
		_advance(_player(), 7)
		var is_every_tick: bool = timing == LudusAgent.ActionTiming.EVERY_TICK
		equal(agent.applied.size(), 7 if is_every_tick else 3, "actions in 7 ticks")
		equal(agent.episode_steps, 2, "steps")
		agent.free()


func test_the_end_of_an_episode() -> void:
	var agent: StubAgent = _agents(_golden("perceptron_tanh"), 1)[0]
	var player := _player()
	_advance(player, 1)
	equal(agent.num_resets, 1, "resets at the start")
	agent.reward = 0.5
	_advance(player, 4)
	agent.is_over = true
	_advance(player, 1)
	equal(_ended.size(), 0, "an end is seen when the step is over")
	_advance(player, 1)
	equal(_ended, [["stub", agent.get_instance_id(), 1.5, 3]], "what has ended")
	equal(agent.num_resets, 2, "resets")
	equal(agent.episode_steps, 0, "steps of the next episode")
	equal(agent.applied.size(), 7, "it acts in the same tick")


func test_an_episode_is_cut_off() -> void:
	var golden := _golden("perceptron_tanh")
	var limited: StubAgent = _agents(golden, 1)[0]
	limited.max_episode_steps = 2
	var cut: StubAgent = _agents(golden, 1)[0]
	var player := _player()
	_advance(player, 3)
	cut.is_cut = true
	_advance(player, 2)
	var ended := []
	for end in _ended:
		ended.append(end[1])
	equal(ended, [limited.get_instance_id(), cut.get_instance_id()], "ends")
	equal(limited.num_resets + cut.num_resets, 4, "resets")


func test_the_memory_begins_with_the_episode() -> void:
	var golden := _golden("gru")
	var agents := _agents(golden, golden.num_agents)
	var player := _player()
	for step in golden.steps.size():
		var case: Dictionary = golden.steps[step]
		for i in agents.size():
			agents[i].seen = PoolRealArray(case["observation"]["observation"][i])
			agents[i].is_over = float(i) in case["begins"]
		_advance(player, 2)
		for i in agents.size():
			var action: Dictionary = agents[i].applied[-1]
			equal(action["turn"], int(case["discrete"][i][0]), "step %d, agent %d" % [step, i])
			var speed: float = action["speed"][0]
			check(abs(speed - float(case["continuous"][i][0])) < 1e-4, "speed is %f" % speed)


func test_agents_of_a_world_wait_for_each_other() -> void:
	var agents := _in_one_world(_agents(_golden("perceptron_tanh"), 2))
	agents[0].world.episode_mode = LudusWorld.Episode.WORLD
	var player := _player()
	_advance(player, 1)
	agents[0].is_over = true
	_advance(player, 4)
	equal(agents[0].num_resets, 1, "the first waits")
	equal(agents[0].applied.size(), 2, "and does nothing")
	equal(agents[1].applied.size(), 5, "the second plays on")
	agents[1].is_over = true
	_advance(player, 2)
	for agent in agents:
		equal(agent.num_resets, 2, "both begin anew")
	equal(agents[0].applied.size(), 3, "and act")
	equal(_ended.size(), 2, "ends")


func test_policies_of_a_world_are_told_each_its_own_return() -> void:
	var agents := _in_one_world(_agents(_golden("perceptron_tanh"), 2))
	agents[1].policy_name = "other"
	agents[0].world.episode_mode = LudusWorld.Episode.WORLD
	agents[0].reward = 1.0
	agents[1].reward = -0.5
	var player := _player()
	_advance(player, 4)
	agents[0].is_over = true
	agents[1].is_over = true
	_advance(player, 1)
	equal(_ended.size(), 2, "ends")
	equal(_ended[0], ["stub", agents[0].get_instance_id(), 2.0, 2], "the one")
	equal(_ended[1], ["other", agents[1].get_instance_id(), -1.0, 2], "the other")


func test_an_agent_begins_anew_by_itself() -> void:
	var agents := _in_one_world(_agents(_golden("perceptron_tanh"), 2))
	var player := _player()
	_advance(player, 1)
	var num_episodes: int = agents[0].world.num_episodes
	agents[0].is_over = true
	_advance(player, 2)
	equal(agents[0].num_resets, 2, "resets")
	equal(agents[1].num_resets, 1, "the other plays on")
	equal(agents[0].world.num_episodes, num_episodes + 1, "the random stream moves on")


func test_settle_ticks_pass_first() -> void:
	var agents := _in_one_world(_agents(_golden("perceptron_tanh"), 1))
	agents[0].world.settle_ticks = 3
	var player := _player()
	_advance(player, 4)
	equal(agents[0].applied.size(), 0, "actions before it has settled")
	_advance(player, 1)
	equal(agents[0].applied.size(), 1, "actions afterwards")


func test_nobody_acts_in_a_paused_game() -> void:
	var agent: StubAgent = _agents(_golden("perceptron_tanh"), 1)[0]
	var player := _player()
	tree.paused = true
	_advance(player, 4)
	equal(agent.applied.size(), 0, "actions")
	tree.paused = false
	_advance(player, 1)
	equal(agent.applied.size(), 1, "actions")


func test_draws_depend_on_the_seed_only() -> void:
	var drawn: Array = []
	for seed_value in [5, 5, 6]:
		var agent: StubAgent = _agents(_golden("perceptron_tanh"), 1)[0]
		agent.sample_actions = true
		var _moved := _in_one_world([agent])
		agent.world.set_seed(seed_value)
		_advance(_player(), 60)
		drawn.append(agent.applied)
		agent.get_parent().free()
	check(drawn[0] == drawn[1], "equal seeds")
	check(drawn[0] != drawn[2], "other seeds")
