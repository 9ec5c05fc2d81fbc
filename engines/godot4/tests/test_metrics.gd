extends "ludus_test.gd"
## What the game reports is summed up by name (PROTOCOL.md §8).

const LudusMetrics := preload("res://addons/ludus/bridge/metrics.gd")

const Golden := preload("golden.gd")


func test_what_was_reported_is_written() -> void:
	var metrics := LudusMetrics.new()
	metrics.is_open = true
	var node := Node.new()
	for value: float in [2.0, 1.0, 4.0, 3.0]:
		metrics.add("jumps", value, node)
	metrics.add("Höhe ✓", -0.5, node)
	node.free()
	var golden := Golden.read(golden_folder, "result_requests_metrics")
	equal(metrics.take(), [golden.content["value"][1]], "behind the requests")
	equal(metrics.take().size(), 0, "nothing is taken twice")
	equal(metrics.error, "", "nothing is wrong")


func test_nothing_is_kept_without_a_trainer() -> void:
	var metrics := LudusMetrics.new()
	metrics.add("jumps", NAN, null)
	equal(metrics.take().size(), 0, "nothing")
	equal(metrics.error, "", "nothing is wrong")
