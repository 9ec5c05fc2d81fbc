extends "ludus_test.gd"
## Outcomes of steps, and mistakes of the game with their place.

const StubAgent := preload("stub_agent.gd")


func test_the_limit_of_steps_truncates() -> void:
	var batch := _batch(_agents(2), 3)
	batch.activate_all()
	for step in [1, 2, 3]:
		batch.collect_outcomes()
		equal(batch.final_slots, PoolIntArray([0, 1] if step == 3 else []), "step %d" % step)
	equal(batch.active, PoolByteArray([0, 0]), "active")


func test_an_end_wins_over_a_cut() -> void:
	var agents := _agents(1)
	agents[0].is_over = true
	agents[0].is_cut = true
	var batch := _batch(agents, 1)
	batch.activate_all()
	batch.collect_outcomes()
	var bytes := batch.to_bytes()
	equal(int(bytes[24]), 1, "terminated")
	equal(int(bytes[32]), 0, "truncated")


func test_inactive_slots_are_left_alone() -> void:
	var agents := _agents(2)
	agents[0].reward = 5.0
	agents[0].is_over = true
	var batch := _batch(agents)
	batch.activate(1)
	batch.collect_outcomes()
	equal(batch.final_slots.size(), 0, "ends")
	equal(agents[0].get_episode_steps(), 0, "steps of the inactive agent")
	equal(agents[1].get_episode_steps(), 1, "steps of the active agent")


func test_inactive_slots_observe_zeros() -> void:
	var batch := _batch(_agents(2))
	batch.activate(1)
	equal(_observed(batch), [0.0, 0.0, 0.0, 1.0, 2.0, 3.0], "")


func test_who_is_alone_is_observed_with_its_outcome() -> void:
	var agents := _agents(3)
	var batch := _batch(agents)
	batch.are_alone = true
	batch.activate(0)
	batch.activate(1)
	agents[1].is_over = true
	batch.collect_outcomes()
	agents[0].seen = PoolRealArray([7, 8, 9])
	agents[1].seen = PoolRealArray([4, 5, 6])
	equal(_observed(batch), [1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], "one goes on")
	batch.activate(1)
	equal(_observed(batch), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 0.0, 0.0, 0.0], "one begins anew")
	var final := batch.final_to_bytes()
	equal(Array(LudusWire.read_floats(final, 16, 3)), [1.0, 2.0, 3.0], "final observation")
	batch.clear_outcomes()
	equal(_observed(batch), [7.0, 8.0, 9.0, 4.0, 5.0, 6.0, 0.0, 0.0, 0.0], "after a reset")


func test_an_agent_that_left_has_ended() -> void:
	var agents := _agents(2)
	var batch := _batch(agents)
	batch.activate_all()
	agents[0].free()
	batch.drop_leavers()
	batch.collect_outcomes()
	equal(batch.final_slots, PoolIntArray([0]), "final slots")
	equal(batch.active, PoolByteArray([0, 1]), "active")
	batch.collect_outcomes()
	equal(batch.final_slots.size(), 0, "reported once")


func test_actions_are_repeated_every_tick_or_not() -> void:
	for timing in LudusAgent.ActionTiming.values():
		var agents := _agents(1)
		agents[0].action_timing = timing
		var batch := _batch(agents)
		batch.activate_all()
		var _end := batch.read_actions(LudusWire.long_bytes([1]), 0)
		batch.hand_out_actions()
		batch.repeat_actions()
		var is_every_tick: bool = timing == LudusAgent.ActionTiming.EVERY_TICK
		equal(agents[0].applied, [1, 1] if is_every_tick else [1], "actions")


func test_entries_are_inferred() -> void:
	var agent: StubAgent = _agents(1)[0]
	agent.observation = []
	agent.seen = {"rays": PoolRealArray([1, 2]), "count": PoolIntArray([3])}
	var entries: Array = _batch([agent]).to_json(1)["observation"]
	equal([entries[0]["name"], entries[1]["name"]], ["rays", "count"], "names")
	equal([entries[0]["dtype"], entries[1]["dtype"]], ["float32", "int64"], "types")


func test_nothing_to_infer_is_a_mistake() -> void:
	for value in [null, "text", [], {"rays": Vector2.ONE}]:
		var agent: StubAgent = _agents(1)[0]
		agent.observation = []
		agent.seen = value
		var batch := _batch([agent])
		check("get_observation() returned no numbers" in batch.error, batch.error)
	var silent: StubAgent = _agents(1)[0]
	silent.observation = []
	silent.seen = {}
	check(not _batch([silent]).error.empty(), "an empty dictionary")


func test_an_observation_that_does_not_fit() -> void:
	var expectations := {
		"PoolRealArray of 2": PoolRealArray([1, 2]),
		"PoolRealArray of 0": PoolRealArray(),
		"Array of 4": [1, 2, 3, 4],
		"null": null,
		"String": "text",
	}
	for found in expectations:
		var agents := _agents(2)
		var batch := _batch(agents)
		batch.activate_all()
		batch.collect_outcomes()
		agents[1].seen = expectations[found]
		equal(batch.to_bytes().size(), 24 + 8 + 3 * 8, "size of the frame in spite of it")
		var expected: String = (
			'world 0, agent ., step 1: observation["observation"]: expected 3 numbers, got %s'
			% found
		)
		equal(batch.error, expected, found)


func test_wrong_sizes_do_not_cancel_out() -> void:
	var agents := _agents(2)
	var batch := _batch(agents)
	batch.activate_all()
	agents[0].seen = PoolRealArray([1, 2])
	agents[1].seen = PoolRealArray([1, 2, 3, 4])
	var _bytes := batch.to_bytes()
	check("PoolRealArray of 2" in batch.error, batch.error)


func test_a_missing_entry_is_named() -> void:
	var agent: StubAgent = _agents(1)[0]
	agent.observation.append(LudusObservationEntry.create("rays", PoolIntArray([2])))
	agent.seen = {"observation": [1, 2, 3]}
	var batch := _batch([agent])
	batch.activate_all()
	var _bytes := batch.to_bytes()
	check('observation["rays"]: expected 2 numbers, got null' in batch.error, batch.error)


func test_the_first_mistake_is_kept() -> void:
	var agents := _agents(2)
	agents[0].seen = [1]
	agents[1].seen = [1, 2]
	var batch := _batch(agents)
	batch.activate_all()
	var _bytes := batch.to_bytes()
	check("Array of 1" in batch.error, batch.error)


func test_a_mask_that_does_not_fit() -> void:
	var agents := _agents(1)
	agents[0].has_action_mask = true
	agents[0].mask = PoolByteArray([1])
	var batch := _batch(agents)
	batch.activate_all()
	var _bytes := batch.to_bytes()
	check("get_action_mask(): expected 2 bytes, got PoolByteArray of 1" in batch.error, batch.error)


func test_random_play_acts_within_limits_and_alike_in_all_ticks_of_a_step() -> void:
	var agents := _agents(2)
	for agent in agents:
		agent.action = [
			LudusActionComponent.discrete("turn", 3),
			LudusActionComponent.continuous("move", 2, -0.5, 2.0)
		]
	var batch := _batch(agents)
	var rng := RandomNumberGenerator.new()
	rng.seed = 1
	for _i in 100:
		batch.play_randomly(rng)
		batch.repeat_actions()
	var turns := {}
	for agent in agents:
		equal(agent.applied.size(), 200, "actions")
		for tick in range(0, 200, 2):
			var action: Dictionary = agent.applied[tick]
			equal(agent.applied[tick + 1], action, "tick %d" % (tick + 1))
			turns[action["turn"]] = true
			for number in action["move"]:
				check(number >= -0.5 and number <= 2.0, "move is %f" % number)
	equal(turns.size(), 3, "all choices are taken")
	check(agents[0].applied != agents[1].applied, "agents draw for themselves")


func test_random_play_begins_anew_after_an_end_or_a_cut() -> void:
	var agents := _agents(3)
	agents[0].is_over = true
	agents[1].is_cut = true
	_batch(agents).play_randomly(RandomNumberGenerator.new())
	equal([agents[0].num_resets, agents[1].num_resets, agents[2].num_resets], [1, 1, 0], "episodes")


func _agents(count: int) -> Array:
	var agents := []
	for _i in count:
		var agent := StubAgent.new()
		agent.observation = [LudusObservationEntry.create("observation", PoolIntArray([3]))]
		agent.action = [LudusActionComponent.discrete("push", 2)]
		agent.seen = PoolRealArray([1, 2, 3])
		add(agent)
		equal(agent.connect_to_game(), "", "a stub agent")
		agents.append(agent)
	return agents


func _batch(agents: Array, max_steps: int = 0) -> LudusPolicyBatch:
	var worlds := PoolIntArray()
	for _agent in agents:
		worlds.append(0)
	return LudusPolicyBatch.new("stub", agents, worlds, max_steps)


func _observed(batch: LudusPolicyBatch) -> Array:
	return Array(LudusWire.read_floats(batch.to_bytes(), 0, 3 * batch.agents.size()))
