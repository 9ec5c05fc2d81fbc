extends "ludus_test.gd"
## What the game asks of its trainer, and hears from it (PROTOCOL.md §8).

const LudusAutoload := preload("res://addons/ludus/bridge/ludus_bridge.gd")
const LudusCall := preload("res://addons/ludus/bridge/call.gd")
const LudusMetrics := preload("res://addons/ludus/bridge/metrics.gd")
const LudusRequests := preload("res://addons/ludus/bridge/requests.gd")
const LudusWire := preload("res://addons/ludus/bridge/wire.gd")

const Golden := preload("golden.gd")
const TRAIN := LudusBridge.PolicyMode.TRAIN
const FROZEN := LudusBridge.PolicyMode.FROZEN
const DETERMINISTIC := LudusBridge.PolicyMode.DETERMINISTIC


func test_the_modes_have_the_words_of_the_protocol() -> void:
	var words := PackedStringArray()
	for name: String in LudusBridge.PolicyMode.keys():
		words.append(name.to_lower())
	equal(words, LudusRequests.MODES, "the words, in the order of the enum")


func test_every_kind_of_request_is_written() -> void:
	var requests := _open()
	check(requests.set_mode("hero", FROZEN), "set_mode")
	check(requests.set_mode("Ziel ✓", DETERMINISTIC), "set_mode of another")
	check(requests.set_mode("hero", TRAIN), "set_mode again")
	check(requests.add({"kind": "save"}), "save")
	check(requests.add({"kind": "stop"}), "stop")
	var golden := Golden.read(golden_folder, "result_requests")
	equal(Array(requests.take()), golden.content["value"], "in the order they were made")


func test_the_flag_is_set_while_requests_wait() -> void:
	var requests := _open()
	equal(requests.flags(), 0, "before")
	requests.add({"kind": "save"})
	equal(requests.flags(), 2, "while one waits")
	equal(requests.flags(), 2, "still")
	requests.take()
	equal(requests.flags(), 0, "after")
	equal(requests.take().size(), 0, "nothing is taken twice")


func test_of_equal_requests_the_latest_counts() -> void:
	var requests := _open()
	requests.set_mode("hero", FROZEN)
	requests.add({"kind": "save"})
	requests.set_mode("hero", TRAIN)
	requests.set_mode("hero", FROZEN)
	var modes := requests.take().map(
		func(taken: Dictionary) -> String: return taken.get("mode", "")
	)
	equal(modes, ["", "train", "frozen"], "what was asked last comes last")


func test_the_oldest_request_goes_when_the_queue_is_full() -> void:
	var requests := _open()
	for i: int in 258:
		check(requests.add({"kind": "other", "number": i}), "request %d" % i)
	var taken := requests.take()
	equal(taken.size(), 256, "what is kept")
	equal(taken[0]["number"], 2, "the oldest of them")
	equal(taken[255]["number"], 257, "the newest")


func test_nobody_listens() -> void:
	var alone := LudusRequests.new()
	var ignored := LudusRequests.new()
	ignored.open(["call", "rebuild", 7])
	for requests: LudusRequests in [alone, ignored]:
		check(not requests.add({"kind": "save"}), "save is refused")
		check(not requests.set_mode("hero", TRAIN), "set_mode is refused")
		equal(requests.flags(), 0, "no flag")
		equal(requests.take().size(), 0, "nothing waits")


func test_a_policy_that_is_none_is_refused() -> void:
	var requests := _open()
	check(not requests.set_mode("", FROZEN), "no name")
	check(not requests.set_mode("x".repeat(129), FROZEN), "a name that is too long")
	check(requests.set_mode("villain", FROZEN), "any name, before the policies are known")
	requests.take()
	requests.policy_names = ["hero", "target"]
	check(not requests.set_mode("villain", FROZEN), "an unknown name")
	check(requests.set_mode("target", FROZEN), "a known name")
	for mode: int in [-1, 3]:
		check(not requests.set_mode("hero", mode), "mode %d" % mode)
	equal(requests.take().size(), 1, "what was let in")


func test_a_bridge_without_a_trainer() -> void:
	var bridge := LudusAutoload.new()
	check(not bridge.set_policy_mode("hero", FROZEN), "set_policy_mode")
	check(not bridge.save_checkpoint(), "save_checkpoint")
	check(not bridge.stop_training(), "stop_training")
	bridge.free()


func test_a_status_is_told_with_the_modes_that_changed() -> void:
	var golden := Golden.read(golden_folder, "call_show_status")
	var status: Dictionary = golden.content["arguments"][0]
	var heard := _show([status, status, _with_mode(status, "hero", "train")])
	equal(heard["statuses"], [status, status, _with_mode(status, "hero", "train")], "statuses")
	var modes := [["hero", FROZEN], ["Ziel ✓", TRAIN], ["hero", TRAIN]]
	equal(heard["modes"], modes, "the first ones, then the one that changed")


func test_a_status_may_lack_or_garble_anything() -> void:
	var odd: Array[Dictionary] = [
		{},
		{"policies": null},
		{"policies": []},
		{"policies": {"hero": null}},
		{"policies": {"hero": 7.0}},
		{"policies": {"hero": {}}},
		{"policies": {"hero": {"mode": null}}},
		{"policies": {"hero": {"mode": "asleep"}}},
	]
	var heard := _show(odd)
	equal(heard["statuses"].size(), odd.size(), "all are handed on")
	equal(heard["modes"], [], "no mode is known")


func test_calls_of_the_bridge() -> void:
	var requests := _open()
	requests.add({"kind": "save"})
	var answers := {
		"take_requests": {"id": 9.0, "value": [{"kind": "save"}]},
		"show_status": {"id": 9.0, "error": "show_status takes one object"},
		"queue_free": {"id": 9.0, "error": "the add-on has no method queue_free"},
		"add": {"id": 9.0, "error": "the add-on has no method add"},
	}
	for method: String in answers:
		equal(_answer(requests, method, []), answers[method], method)
	for arguments: Array in [[7], [null], [[]], [{}, {}]]:
		equal(_answer(requests, "show_status", arguments), answers["show_status"], str(arguments))
	equal(_answer(requests, "show_status", [{}]), {"id": 9.0, "value": null}, "a right status")


func test_what_is_a_call_of_the_bridge() -> void:
	for golden_name: String in ["call_bridge", "call_take_requests", "call_show_status"]:
		var golden := Golden.read(golden_folder, golden_name)
		check(LudusCall.new(golden.payload()).is_for_bridge(), golden_name)
	for value: String in ["false", "null", "1", '"true"', "[true]", "{}"]:
		var text := '{"target": {"bridge": %s}}' % value
		check(not LudusCall.new(text.to_utf8_buffer()).is_for_bridge(), text)


func _open() -> LudusRequests:
	var requests := LudusRequests.new()
	requests.open(["call", "requests"])
	return requests


## Tells statuses and returns what a game hears of it.
func _show(told: Array) -> Dictionary:
	var heard := {"statuses": [], "modes": []}
	var bridge := LudusAutoload.new()
	bridge.training_status.connect(func(one: Dictionary) -> void: heard["statuses"].append(one))
	bridge.policy_mode_changed.connect(
		func(policy: String, mode: int) -> void: heard["modes"].append([policy, mode])
	)
	for one: Dictionary in told:
		bridge._requests.take_in(one)
	bridge.free()
	return heard


func _with_mode(status: Dictionary, policy: String, mode: String) -> Dictionary:
	var changed := status.duplicate(true)
	changed["policies"][policy]["mode"] = mode
	return changed


func _answer(requests: LudusRequests, method: String, arguments: Array) -> Dictionary:
	var message := {"id": 9, "target": {"bridge": true}, "method": method, "arguments": arguments}
	var call := LudusCall.new(JSON.stringify(message).to_utf8_buffer())
	var frame := call.answer_for_bridge(requests, LudusMetrics.new())
	return LudusWire.read_json(frame.slice(LudusWire.HEADER_BYTES))
