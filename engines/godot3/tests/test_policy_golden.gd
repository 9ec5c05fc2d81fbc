extends "ludus_test.gd"
## GDScript computes what the golden policies say.

const GoldenPolicy := preload("golden_policy.gd")

const TOLERANCE := 1e-5


func test_there_are_policies() -> void:
	check(GoldenPolicy.names(golden_folder).size() >= 9, "no golden policies")


func test_all_rows_together() -> void:
	for golden in _all():
		_play(golden, [range(golden.num_agents)])


func test_each_row_alone() -> void:
	for golden in _all():
		var groups := []
		for slot in golden.num_agents:
			groups.append([slot])
		_play(golden, groups)


func test_some_rows_in_another_order() -> void:
	for golden in _all():
		_play(golden, [[3, 0], [4, 2, 1]])


func _all() -> Array:
	var found := []
	for name in GoldenPolicy.names(golden_folder):
		var golden := GoldenPolicy.new(golden_folder, name)
		equal(golden.policy.error, "", name)
		equal(golden.policy.policy_name, name, "name")
		found.append(golden)
	return found


## Plays all steps; in each, the rows are computed in groups.
func _play(golden: GoldenPolicy, groups: Array) -> void:
	var network := golden.policy.network()
	var actions := LudusPolicyActions.new(golden.policy.reader())
	actions.reserve(golden.num_agents)
	var frames := LudusPolicyFrames.new(golden.policy.reader().frames)
	frames.reserve(golden.num_agents)
	var states := []
	states.resize(golden.num_agents * network.memory_blocks)
	for step in golden.steps.size():
		var case: Dictionary = golden.steps[step]
		for slot in case["begins"]:
			frames.begin(slot)
			for i in network.memory_blocks:
				states[slot * network.memory_blocks + i] = Vector3.ZERO
		var masks := PoolByteArray()
		if case["action_mask"] != null:
			masks = PoolByteArray(GoldenPolicy.flat(case["action_mask"]))
		var vectors := golden.observed(step, frames, false)
		var images := golden.observed(step, frames, true)
		frames.end_step(range(golden.num_agents))
		for slots in groups:
			network.run(slots, vectors, images, states)
			for row in slots.size():
				var from: int = row * network.num_outputs
				actions.choose(network.outputs, from, slots[row], masks, null)
				var outputs := network.outputs.slice(from, from + network.num_outputs - 1)
				var what := "%s, step %d" % [golden.name, step]
				_close(outputs, case["outputs"][slots[row]], what)
		var choices := PoolIntArray(GoldenPolicy.flat(case["discrete"]))
		equal(PoolIntArray(actions.discrete), choices, golden.name)
		_close(actions.continuous, GoldenPolicy.flat(case["continuous"]), golden.name)
		_check_memory(golden, step, states)


func _check_memory(golden: GoldenPolicy, step: int, states: Array) -> void:
	var memory = golden.steps[step]["memory"]
	if memory == null:
		return
	var num_blocks := golden.policy.network().memory_blocks
	for slot in golden.num_agents:
		var numbers := []
		for i in memory[slot].size():
			numbers.append(states[slot * num_blocks + i / 3][i % 3])
		_close(numbers, memory[slot], "%s, memory in step %d" % [golden.name, step])


func _close(got: Array, expected: Array, what: String) -> void:
	equal(got.size(), expected.size(), what)
	var largest := 0.0
	for i in min(got.size(), expected.size()):
		largest = max(largest, abs(got[i] - expected[i]) / max(1.0, abs(expected[i])))
	check(largest < TOLERANCE, "%s: off by %s" % [what, largest])
