extends "ludus_test.gd"
## What a client of godot_gym_api may ask, and what not.

const Request := preload("../addons/ludus_classic/rl_request.gd")


func test_requests_are_read() -> void:
	for text in [
		'{"reset":1,"observation":{"agent":[],"world":["far"]}}',
		'{"action":{"move":[0.5,null]},"observation":{}}',
		'{"action":null}',
		'{"config":{"agent":{"a":1},"world":{},"environment":{"repeat_action":2,"time_speed":0.5}}}',
	]:
		var request := _read(text)
		equal(request.error, "", text)
		equal(request.content, parse_json(text), text)
		equal(request.unknown_keys, [], text)


func test_unknown_keys_do_no_harm() -> void:
	var request := _read('{"reset":1,"seed":7}')
	equal(request.error, "", "error")
	equal(request.unknown_keys, ["seed"], "unknown keys")


func test_what_is_no_request() -> void:
	for text in ["", "[]", "3", "null", '{"reset"', "{}", '{"seed":1}', '{"action":NaN}']:
		_refused(text, "a request ")


func test_wrong_parts() -> void:
	_refused('{"observation":[]}', "observation must be an object")
	_refused('{"observation":null}', "observation must be an object")
	_refused('{"config":4}', "config must be an object")
	_refused('{"config":{"agent":[]}}', "config.agent must be an object")
	_refused('{"config":{"environment":4}}', "config.environment must be an object")


func test_wrong_settings() -> void:
	for value in ["0", "-1", "1e999", "1e7", '"4"', "null", "[4]", "true", "2.5"]:
		_refused('{"config":{"environment":{"repeat_action":%s}}}' % value, "repeat_action must be")
	for value in ["0", "-1", "1e999", "-1e999", "1e4", '"1"', "null", "{}"]:
		_refused('{"config":{"environment":{"time_speed":%s}}}' % value, "time_speed must be")


func test_bytes_that_are_no_text() -> void:
	var text := PoolByteArray([255, 254, 0, 123]).get_string_from_utf8()
	check(not _read(text).error.empty(), "not refused")


func test_nesting_has_a_limit() -> void:
	for opening in ["[", '{"a":']:
		var closing := "]" if opening == "[" else "}"
		var deep: String = opening.repeat(999) + "1" + closing.repeat(999)
		equal(_read('{"action":%s}' % deep).error, "", "999 times %s" % opening)
		_refused('{"action":%s}' % opening.repeat(200000), "nested more than 1000 deep")


func test_brackets_in_texts_do_not_count() -> void:
	equal(_read('{"action":"%s"}' % "[{".repeat(5000)).error, "", "opening")
	var closing := '\\"]'.repeat(3000)
	_refused('{"action":["%s",%s]}' % [closing, "[".repeat(200000)], "nested more than")
	equal(_read('{"action":[%s1]}' % "[],".repeat(5000)).error, "", "beside one another")


func _read(text: String) -> Request:
	var request := Request.new()
	request.read(text)
	return request


func test_nothing_of_the_last_request_is_left() -> void:
	var request := Request.new()
	request.read('{"reset":1,"seed":7}')
	request.read("[]")
	check(request.content.empty() and not request.error.empty(), "a wrong one after a right one")
	request.read('{"action":1}')
	equal([request.error, request.unknown_keys], ["", []], "a right one after a wrong one")


func _refused(text: String, what: String) -> void:
	var request := _read(text)
	check(not request.error.empty(), "not refused: %s" % text.left(60))
	check(what in request.error, "%s: %s" % [text.left(60), request.error])
	check(request.content.empty(), "content after an error: %s" % text.left(60))
