extends "ludus_test.gd"
## Outcomes of steps, and mistakes of the game with their place.

const LudusPolicyBatch := preload("res://addons/ludus/agent/policy_batch.gd")

const LudusScriptReview := preload("res://addons/ludus/agent/script_review.gd")
const StubAgent := preload("stub_agent.gd")


func test_the_limit_of_steps_truncates() -> void:
	var batch := _batch(_agents(2), 3)
	for step: int in [1, 2, 3]:
		batch.active.fill(1)
		batch.collect_outcomes()
		var expected := PackedInt32Array([0, 1]) if step == 3 else PackedInt32Array()
		equal(batch.final_slots, expected, "step %d" % step)
	equal(batch.active, PackedByteArray([0, 0]), "active")


func test_an_end_wins_over_a_cut() -> void:
	var agents := _agents(1)
	agents[0].is_over = true
	agents[0].is_cut = true
	var batch := _batch(agents, 1)
	batch.active.fill(1)
	batch.collect_outcomes()
	var frame := PackedByteArray()
	batch.append_to(frame)
	equal(frame[24], 1, "terminated")
	equal(frame[32], 0, "truncated")


func test_inactive_slots_are_left_alone() -> void:
	var agents := _agents(2)
	agents[0].reward = 5.0
	agents[0].is_over = true
	var batch := _batch(agents)
	batch.active = PackedByteArray([0, 1])
	batch.collect_outcomes()
	equal(batch.final_slots.size(), 0, "ends")
	equal(agents[0].episode_steps, 0, "steps of the inactive agent")
	equal(agents[1].episode_steps, 1, "steps of the active agent")


func test_an_agent_that_left_has_ended() -> void:
	var agents := _agents(2)
	var batch := _batch(agents)
	batch.active.fill(1)
	agents[0].free()
	batch.drop_leavers()
	batch.collect_outcomes()
	equal(batch.final_slots, PackedInt32Array([0]), "final slots")
	equal(batch.active, PackedByteArray([0, 1]), "active")
	batch.collect_outcomes()
	equal(batch.final_slots.size(), 0, "reported once")


func test_actions_are_repeated_every_tick_or_not() -> void:
	for timing: LudusAgent.ActionTiming in LudusAgent.ActionTiming.values():
		var agents := _agents(1)
		agents[0].action_timing = timing
		var batch := _batch(agents)
		batch.active.fill(1)
		batch.read_actions(PackedInt64Array([1]).to_byte_array(), 0)
		batch.hand_out_actions()
		batch.repeat_actions()
		var is_every_tick := timing == LudusAgent.ActionTiming.EVERY_TICK
		equal(agents[0].applied.size(), 2 if is_every_tick else 1, "actions")


func test_entries_are_inferred() -> void:
	var agent := _agents(1)[0]
	agent.observation = []
	agent.seen = {"rays": PackedFloat32Array([1, 2]), "count": PackedInt64Array([3])}
	var entries: Array = _batch([agent]).to_json(1)["observation"]
	equal(entries.map(func(e: Dictionary) -> String: return e["name"]), ["rays", "count"], "names")
	equal(entries.map(func(e: Dictionary) -> String: return e["dtype"]), ["float32", "int64"], "")


func test_nothing_to_infer_is_a_mistake() -> void:
	for value: Variant in [null, "text", [], {"rays": Vector2.ONE}]:
		var agent := _agents(1)[0]
		agent.observation = []
		agent.seen = value
		var batch := _batch([agent])
		check("get_observation() returned no numbers" in batch.error, batch.error)
	var silent := _agents(1)[0]
	silent.observation = []
	silent.seen = {}
	check(not _batch([silent]).error.is_empty(), "an empty dictionary")


func test_an_observation_that_does_not_fit() -> void:
	var expectations := {
		"PackedFloat32Array of 2": PackedFloat32Array([1, 2]),
		"PackedFloat32Array of 0": PackedFloat32Array(),
		"Array of 4": [1, 2, 3, 4],
		"nothing (null): does it lack a `return`?": null,
		"String": "text",
	}
	for found: String in expectations:
		var agents := _agents(2)
		var batch := _batch(agents)
		batch.active.fill(1)
		batch.collect_outcomes()
		agents[1].seen = expectations[found]
		var frame := PackedByteArray()
		batch.append_to(frame)
		var expected := (
			(
				"world 0, agent . (res://tests/stub_agent.gd), step 1: "
				+ 'observation["observation"]: expected 3 numbers, got %s'
			)
			% found
		)
		equal(batch.error, expected, found)
		equal(frame.size(), 24 + 8 + 3 * 8, "size of the frame in spite of it")


func test_observations_keep_their_places_between_slots_that_do_not_act() -> void:
	var agents := _agents(4)
	var batch := _batch(agents)
	for slot: int in 4:
		agents[slot].seen = PackedFloat32Array([slot, slot, slot])
	batch.active = PackedByteArray([0, 1, 0, 1])
	var frame := PackedByteArray()
	batch.append_observations(frame)
	var expected := PackedFloat32Array([0, 0, 0, 1, 1, 1, 0, 0, 0, 3, 3, 3])
	equal(frame.to_float32_array(), expected, "the second and the fourth one act")
	batch.active = PackedByteArray([1, 0, 1, 0])
	frame.clear()
	batch.append_observations(frame)
	expected = PackedFloat32Array([0, 0, 0, 0, 0, 0, 2, 2, 2, 0, 0, 0])
	equal(frame.to_float32_array(), expected, "the first and the third one act")


func test_outcomes_are_looked_at_unless_their_types_are_declared() -> void:
	check(LudusScriptReview.declares_outcomes(StubAgent), "the stub declares them")
	check(not LudusScriptReview.declares_outcomes(null), "no script")
	var typed := "func is_done() -> bool:\n\treturn false\n"
	for reward: String in [
		"func get_reward() -> Variant:\n\treturn null\n", "func get_reward() -> int:\n\treturn 1\n"
	]:
		var script := GDScript.new()
		script.source_code = "extends Node\n" + typed + reward
		script.reload()
		check(not LudusScriptReview.declares_outcomes(script), reward)


func test_a_missing_entry_is_named() -> void:
	var agent := _agents(1)[0]
	agent.observation.append(LudusObservationEntry.create("rays", [2]))
	agent.seen = {"observation": [1, 2, 3]}
	var batch := _batch([agent])
	batch.active.fill(1)
	batch.append_to(PackedByteArray())
	check('observation["rays"]: expected 2 numbers, got nothing' in batch.error, batch.error)


func test_the_first_mistake_is_kept() -> void:
	var agents := _agents(2)
	agents[0].seen = [1]
	agents[1].seen = [1, 2]
	var batch := _batch(agents)
	batch.active.fill(1)
	batch.append_to(PackedByteArray())
	check("Array of 1" in batch.error, batch.error)


func test_a_mask_that_does_not_fit() -> void:
	var agents := _agents(1)
	agents[0].has_action_mask = true
	agents[0].mask = PackedByteArray([1])
	var batch := _batch(agents)
	batch.active.fill(1)
	batch.append_to(PackedByteArray())
	check(
		"get_action_mask(): expected 2 bytes, got PackedByteArray of 1" in batch.error, batch.error
	)


func test_random_play_acts_within_limits_and_alike_in_all_ticks_of_a_step() -> void:
	var agents := _agents(2)
	for agent: StubAgent in agents:
		agent.action = [
			LudusActionComponent.discrete("turn", 3),
			LudusActionComponent.continuous("move", 2, -0.5, 2.0)
		]
	var batch := _batch(agents)
	var rng := RandomNumberGenerator.new()
	rng.seed = 1
	for i: int in 100:
		batch.play_randomly(rng)
		batch.repeat_actions()
	var turns := {}
	for agent: StubAgent in agents:
		equal(agent.applied.size(), 200, "actions")
		for tick: int in range(0, 200, 2):
			var action: Dictionary = agent.applied[tick]
			equal(agent.applied[tick + 1], action, "tick %d" % (tick + 1))
			turns[action["turn"]] = true
			for number: float in action["move"]:
				check(number >= -0.5 and number <= 2.0, "move is %f" % number)
	equal(turns.size(), 3, "all choices are taken")
	check(agents[0].applied != agents[1].applied, "agents draw for themselves")


func test_random_play_begins_anew_after_an_end_or_a_cut() -> void:
	var agents := _agents(3)
	agents[0].is_over = true
	agents[1].is_cut = true
	_batch(agents).play_randomly(RandomNumberGenerator.new())
	equal(agents.map(func(a: StubAgent) -> int: return a.num_resets), [1, 1, 0], "episodes")


func _agents(count: int) -> Array[StubAgent]:
	var agents: Array[StubAgent] = []
	for i: int in count:
		var agent := StubAgent.new()
		agent.observation = [LudusObservationEntry.create("observation", [3])]
		agent.action = [LudusActionComponent.discrete("push", 2)]
		agent.seen = PackedFloat32Array([1, 2, 3])
		add(agent)
		equal(agent.connect_to_game(), "", "a stub agent")
		agents.append(agent)
	return agents


func _batch(agents: Array[StubAgent], max_steps: int = 0) -> LudusPolicyBatch:
	var members: Array[LudusAgent] = []
	members.assign(agents)
	var worlds := PackedInt32Array()
	worlds.resize(agents.size())
	return LudusPolicyBatch.new("stub", members, worlds, max_steps)
