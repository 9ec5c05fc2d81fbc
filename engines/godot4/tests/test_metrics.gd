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


func test_names_have_printable_characters_only() -> void:
	for metric: String in ["Höhe ✓", "e\u0301", "\"it's\\", "日本", "😀", "é".repeat(128)]:
		equal(_error_of(metric, 1.0), "", metric)
	# Of the categories Cc, Cf, Co, Cn, Zs, Zl and Zp.
	var bad := "\t\n\u007f\u0085\u00ad\u200b\u202e\ufeff\ue000\ufffe\u0378\u00a0\u3000\u2028\u2029"
	for character: String in bad:
		check(_error_of("a%sb" % character, 1.0).contains("printable"), character.c_escape())
	for metric: String in [" a", "a ", " "]:
		check(_error_of(metric, 1.0).contains("no space at either end"), metric)
	check(_error_of("é".repeat(129), 1.0).contains("129 characters, expected 1 to 128"), "long")


func test_numbers_that_cannot_be_are_errors() -> void:
	equal(_error_of("a", NAN), "Hero: metric a is nan, expected a finite number", "NaN")
	equal(_error_of("a", -INF), "Hero: metric a is -inf, expected a finite number", "infinity")
	var metrics := LudusMetrics.new()
	metrics.is_open = true
	var node := Node.new()
	metrics.add("a", 1.7e308, node)
	metrics.add("a", 1.7e308, node)
	node.free()
	check(metrics.error.contains("metric a adds up to inf"), metrics.error)


func _error_of(metric: String, value: float) -> String:
	var metrics := LudusMetrics.new()
	metrics.is_open = true
	var node := Node.new()
	node.name = "Hero"
	metrics.add(metric, value, node)
	node.free()
	return metrics.error
