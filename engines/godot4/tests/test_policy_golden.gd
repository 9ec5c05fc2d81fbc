extends "ludus_test.gd"
## GDScript computes what the golden policies say.

const LudusPolicyActions := preload("res://addons/ludus/policy/policy_actions.gd")
const LudusPolicyFrames := preload("res://addons/ludus/policy/policy_frames.gd")

const GoldenPolicy := preload("golden_policy.gd")

const TOLERANCE := 1e-5


func test_there_are_policies() -> void:
	check(GoldenPolicy.names(golden_folder).size() >= 9, "no golden policies")


func test_all_rows_together() -> void:
	for golden: GoldenPolicy in _all():
		var slots := PackedInt32Array(range(golden.num_agents))
		_play(golden, [slots])


func test_each_row_alone() -> void:
	for golden: GoldenPolicy in _all():
		var groups: Array[PackedInt32Array] = []
		for slot: int in golden.num_agents:
			groups.append(PackedInt32Array([slot]))
		_play(golden, groups)


func test_some_rows_in_another_order() -> void:
	for golden: GoldenPolicy in _all():
		_play(golden, [PackedInt32Array([3, 0]), PackedInt32Array([4, 2, 1])])


func _all() -> Array[GoldenPolicy]:
	var found: Array[GoldenPolicy] = []
	for name: String in GoldenPolicy.names(golden_folder):
		var golden: GoldenPolicy = GoldenPolicy.read(golden_folder, name)
		equal(golden.policy.error, "", name)
		equal(golden.policy.policy_name, name, "name")
		found.append(golden)
	return found


## Plays all steps; in each, the rows are computed in groups.
func _play(golden: GoldenPolicy, groups: Array[PackedInt32Array]) -> void:
	var network := golden.policy.network()
	var actions := LudusPolicyActions.new(golden.policy.reader())
	actions.reserve(golden.num_agents)
	var frames := LudusPolicyFrames.new(golden.policy.reader())
	frames.reserve(golden.num_agents)
	var states := PackedVector4Array()
	states.resize(golden.num_agents * network.memory_blocks)
	for step: int in golden.steps.size():
		var case: Dictionary = golden.steps[step]
		for slot: int in case["begins"]:
			frames.begin(slot)
			for i: int in network.memory_blocks:
				states[slot * network.memory_blocks + i] = Vector4.ZERO
		var masks := PackedByteArray()
		if case["action_mask"] != null:
			masks = PackedByteArray(Array(GoldenPolicy.floats(case["action_mask"])))
		var all := PackedInt32Array(range(golden.num_agents))
		var observed := frames.push(golden.observed(step), all)
		for slots: PackedInt32Array in groups:
			network.run(slots, observed, states)
			for row: int in slots.size():
				var from := row * network.num_outputs
				actions.choose(network.outputs, from, slots[row], masks, null)
				var outputs := network.outputs.slice(from, from + network.num_outputs)
				var expected: Array = case["outputs"][slots[row]]
				_close(outputs, PackedFloat32Array(expected), "%s, step %d" % [golden.name, step])
		var chosen := GoldenPolicy.floats(case["discrete"])
		equal(PackedFloat32Array(Array(actions.discrete)), chosen, golden.name)
		_close(actions.continuous, GoldenPolicy.floats(case["continuous"]), golden.name)


func _close(got: PackedFloat32Array, expected: PackedFloat32Array, what: String) -> void:
	equal(got.size(), expected.size(), what)
	var largest := 0.0
	for i: int in mini(got.size(), expected.size()):
		largest = maxf(largest, absf(got[i] - expected[i]) / maxf(1.0, absf(expected[i])))
	check(largest < TOLERANCE, "%s: off by %s" % [what, largest])
