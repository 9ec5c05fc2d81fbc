extends "ludus_test.gd"
## What the game asks of its trainer, and hears from it (PROTOCOL.md §8).

const Golden := preload("golden.gd")
const TRAIN := LudusBridge.PolicyMode.TRAIN
const FROZEN := LudusBridge.PolicyMode.FROZEN
const DETERMINISTIC := LudusBridge.PolicyMode.DETERMINISTIC

var _statuses: Array = []
var _modes: Array = []


func test_the_modes_have_the_words_of_the_protocol() -> void:
	var words := []
	for name in LudusBridge.PolicyMode:
		words.append(name.to_lower())
	equal(words, LudusRequests.MODES, "the words, in the order of the enum")


func test_every_kind_of_request_is_written() -> void:
	var requests := _open()
	check(requests.set_mode("hero", FROZEN), "set_mode")
	check(requests.set_mode("Ziel ✓", DETERMINISTIC), "set_mode of another")
	check(requests.set_mode("hero", TRAIN), "set_mode again")
	check(requests.add({"kind": "save"}), "save")
	check(requests.add({"kind": "stop"}), "stop")
	var golden := Golden.new(golden_folder, "result_requests")
	equal(requests.take(), golden.content["value"], "in the order they were made")


func test_the_flag_is_set_while_requests_wait() -> void:
	var requests := _open()
	equal(requests.flags(), 0, "before")
	check(requests.add({"kind": "save"}), "save")
	equal(requests.flags(), 2, "while one waits")
	equal(requests.take().size(), 1, "one is taken")
	equal(requests.flags(), 0, "after")
	equal(requests.take().size(), 0, "nothing is taken twice")


func test_of_equal_requests_the_latest_counts() -> void:
	var requests := _open()
	check(requests.set_mode("hero", FROZEN), "frozen")
	check(requests.add({"kind": "save"}), "save")
	check(requests.set_mode("hero", TRAIN), "train")
	check(requests.set_mode("hero", FROZEN), "frozen again")
	var modes := []
	for taken in requests.take():
		modes.append(taken.get("mode", ""))
	equal(modes, ["", "train", "frozen"], "what was asked last comes last")


func test_the_oldest_request_goes_when_the_queue_is_full() -> void:
	var requests := _open()
	for i in 258:
		check(requests.add({"kind": "other", "number": i}), "request %d" % i)
	var taken := requests.take()
	equal(taken.size(), 256, "what is kept")
	equal(taken[0]["number"], 2, "the oldest of them")
	equal(taken[255]["number"], 257, "the newest")


func test_nobody_listens() -> void:
	var alone := LudusRequests.new()
	var ignored := LudusRequests.new()
	ignored.open(["call", "rebuild", 7])
	for requests in [alone, ignored]:
		check(not requests.add({"kind": "save"}), "save is refused")
		check(not requests.set_mode("hero", TRAIN), "set_mode is refused")
		equal(requests.flags(), 0, "no flag")
		equal(requests.take().size(), 0, "nothing waits")


func test_a_policy_that_is_none_is_refused() -> void:
	var requests := _open()
	check(not requests.set_mode("", FROZEN), "no name")
	check(not requests.set_mode("x".repeat(129), FROZEN), "a name that is too long")
	check(requests.set_mode("villain", FROZEN), "any name, before the policies are known")
	equal(requests.take().size(), 1, "it was let in")
	requests.policy_names = ["hero", "target"]
	check(not requests.set_mode("villain", FROZEN), "an unknown name")
	check(requests.set_mode("target", FROZEN), "a known name")
	for mode in [-1, 3]:
		check(not requests.set_mode("hero", mode), "mode %d" % mode)
	equal(requests.take().size(), 1, "what was let in")


func test_a_bridge_without_a_trainer() -> void:
	var bridge := LudusBridge.new()
	check(not bridge.set_policy_mode("hero", FROZEN), "set_policy_mode")
	check(not bridge.save_checkpoint(), "save_checkpoint")
	check(not bridge.stop_training(), "stop_training")
	bridge.free()


func test_a_status_is_told_with_the_modes_that_changed() -> void:
	var golden := Golden.new(golden_folder, "call_show_status")
	var status: Dictionary = golden.content["arguments"][0]
	var changed := status.duplicate(true)
	changed["policies"]["hero"]["mode"] = "train"
	_show([status, status, changed])
	equal(_statuses, [status, status, changed], "statuses")
	var modes := [["hero", FROZEN], ["Ziel ✓", TRAIN], ["hero", TRAIN]]
	equal(_modes, modes, "the first ones, then the one that changed")


func test_a_status_may_lack_or_garble_anything() -> void:
	var odd := [
		{},
		{"policies": null},
		{"policies": []},
		{"policies": {"hero": null}},
		{"policies": {"hero": 7.0}},
		{"policies": {"hero": {}}},
		{"policies": {"hero": {"mode": null}}},
		{"policies": {"hero": {"mode": "asleep"}}},
	]
	_show(odd)
	equal(_statuses.size(), odd.size(), "all are handed on")
	equal(_modes, [], "no mode is known")


func test_calls_of_the_bridge() -> void:
	var requests := _open()
	check(requests.add({"kind": "save"}), "save")
	var answers := {
		"take_requests": {"id": 9.0, "value": [{"kind": "save"}]},
		"show_status": {"id": 9.0, "error": "show_status takes one object"},
		"queue_free": {"id": 9.0, "error": "the add-on has no method queue_free"},
		"add": {"id": 9.0, "error": "the add-on has no method add"},
	}
	for method in answers:
		equal(_answer(requests, method, []), answers[method], method)
	for arguments in [[7], [null], [[]], [{}, {}]]:
		equal(_answer(requests, "show_status", arguments), answers["show_status"], str(arguments))
	equal(_answer(requests, "show_status", [{}]), {"id": 9.0, "value": null}, "a right status")


func test_what_is_a_call_of_the_bridge() -> void:
	for golden_name in ["call_bridge", "call_take_requests", "call_show_status"]:
		var golden := Golden.new(golden_folder, golden_name)
		check(LudusCall.new(golden.payload()).is_for_bridge(), golden_name)
	for value in ["false", "null", "1", '"true"', "[true]", "{}"]:
		var text: String = '{"target": {"bridge": %s}}' % value
		check(not LudusCall.new(text.to_utf8()).is_for_bridge(), text)


func _open() -> LudusRequests:
	var requests := LudusRequests.new()
	requests.open(["call", "requests"])
	return requests


## Tells statuses and notes what a game hears of it.
func _show(told: Array) -> void:
	var bridge := LudusBridge.new()
	check(bridge.connect("training_status", self, "_on_status") == OK, "a signal")
	check(bridge.connect("policy_mode_changed", self, "_on_mode") == OK, "a signal")
	for one in told:
		bridge._status.take_in(one)
	bridge.free()


func _on_status(status: Dictionary) -> void:
	_statuses.append(status)


func _on_mode(policy: String, mode: int) -> void:
	_modes.append([policy, mode])


func _answer(requests: LudusRequests, method: String, arguments: Array) -> Dictionary:
	var message := {"id": 9, "target": {"bridge": true}, "method": method, "arguments": arguments}
	var call := LudusCall.new(LudusJson.write(message).to_utf8())
	var frame := call.answer_for_bridge(requests, LudusTrainingStatus.new())
	return LudusWire.read_json(frame.subarray(LudusWire.HEADER_BYTES, -1))
