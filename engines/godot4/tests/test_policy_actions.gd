extends "ludus_test.gd"
## From what a network puts out to actions.

const LudusPolicyActions := preload("res://addons/ludus/policy/policy_actions.gd")
const LudusPolicyReader := preload("res://addons/ludus/policy/policy_reader.gd")

const NUM_DRAWS := 20000

var _rng := RandomNumberGenerator.new()


func _init() -> void:
	_rng.seed = 1


func test_the_best_choice() -> void:
	equal(_choices([1.0, 3.0, 2.0], []), {1: 50}, "the largest")
	equal(_choices([1.0, 2.0, 2.0], []), {1: 50}, "the first of equal ones")
	equal(_choices([1.0, 3.0, 2.0], [1, 0, 1]), {2: 50}, "the largest that is allowed")
	equal(_choices([-1e30, 5.0, 5.0], [1, 0, 0]), {0: 50}, "the only one")
	equal(_choices([1.0, 3.0, 2.0], [0, 0, 0]), {0: 50}, "nothing is allowed")


func test_draws_are_those_of_the_softmax() -> void:
	for mask: Array in [[], [1, 0, 1]]:
		var logits: Array[float] = [0.5, 2.0, -1.0]
		var weights := PackedFloat32Array()
		var total := 0.0
		for i: int in 3:
			weights.append(0.0 if not mask.is_empty() and mask[i] == 0 else exp(logits[i]))
			total += weights[i]
		var counts := _choices(logits, mask, NUM_DRAWS)
		for i: int in 3:
			var share: float = counts.get(i, 0) / float(NUM_DRAWS)
			check(absf(share - weights[i] / total) < 0.02, "choice %d: %f" % [i, share])


func test_numbers_are_cut_off_and_stretched() -> void:
	var actions := _numbers({"is_squashed": false, "log_std": [0.0]})
	for pair: Array in [[0.0, 1.0], [0.5, 2.5], [-3.0, -2.0], [1.5, 4.0]]:
		actions.choose([pair[0]], 0, 0, [], null)
		check(is_equal_approx(actions.continuous[0], pair[1]), "%s" % actions.continuous)


func test_numbers_are_squashed_and_stretched() -> void:
	var actions := _numbers({"is_squashed": true, "log_std": [0.0]})
	for mean: float in [0.0, 0.7, -20.0, 20.0]:
		actions.choose([mean], 0, 0, [], null)
		var expected := 1.0 + 3.0 * tanh(mean)
		check(is_equal_approx(actions.continuous[0], expected), "%s" % actions.continuous)


func test_draws_have_the_right_mean_and_deviation() -> void:
	for log_std: Variant in [[-3.0], null]:
		var actions := _numbers({"is_squashed": false, "log_std": log_std})
		# The deviation that the network puts out is cut to the range, too.
		var outputs := PackedFloat32Array([0.2, -9.0])
		var sum := 0.0
		var squares := 0.0
		for i: int in NUM_DRAWS:
			actions.choose(outputs, 0, 0, [], _rng)
			var unit := (actions.continuous[0] - 1.0) / 3.0
			sum += unit
			squares += unit * unit
		var mean := sum / NUM_DRAWS
		var deviation := sqrt(squares / NUM_DRAWS - mean * mean)
		check(absf(mean - 0.2) < 0.005, "mean is %f" % mean)
		check(absf(deviation / exp(-3.0) - 1.0) < 0.05, "deviation is %f" % deviation)


func test_slots_keep_apart() -> void:
	var read := LudusPolicyReader.new(null)
	read.components = [LudusActionComponent.discrete("a", 2), LudusActionComponent.discrete("b", 3)]
	read.num_logits = 5
	var actions := LudusPolicyActions.new(read)
	actions.reserve(2)
	actions.choose([9, 0, 1, 0, 1, 0, 0, 5], 3, 1, [0, 0, 0, 0, 0, 1, 1, 1, 1, 0], null)
	equal(actions.discrete, PackedInt64Array([0, 0, 1, 0]), "choices")


func _choices(logits: Array, mask: Array, count: int = 50) -> Dictionary:
	var read := LudusPolicyReader.new(null)
	read.components = [LudusActionComponent.discrete("push", logits.size())]
	read.num_logits = logits.size()
	var actions := LudusPolicyActions.new(read)
	actions.reserve(1)
	var counts := {}
	for i: int in count:
		actions.choose(
			PackedFloat32Array(logits), 0, 0, PackedByteArray(mask), _rng if count > 50 else null
		)
		var choice := actions.discrete[0]
		counts[choice] = counts.get(choice, 0) + 1
	return counts


func _numbers(distribution: Dictionary) -> LudusPolicyActions:
	var read := LudusPolicyReader.new(null)
	read.components = [LudusActionComponent.continuous("move", 1, -2.0, 4.0)]
	read.low = [-2.0]
	read.high = [4.0]
	read.is_squashed = distribution["is_squashed"]
	read.log_std_range = [-3.0, 2.0]
	if distribution["log_std"] != null:
		read.log_std = PackedFloat32Array(distribution["log_std"] as Array)
	var actions := LudusPolicyActions.new(read)
	actions.reserve(1)
	return actions
