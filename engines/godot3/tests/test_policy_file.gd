extends "ludus_test.gd"
## What is wrong with a policy file is said, with its place.

const NAN_DATA := "AADAfw=="


func test_a_right_file() -> void:
	var read := LudusPolicyReader.new(_content("gru"))
	equal(read.error, "", "error")
	equal(read.entries[0].shape, PoolIntArray([3]), "shape")
	equal(read.fingerprint.length(), 64, "fingerprint")


func test_mistakes_are_named() -> void:
	var mistakes: Array = [
		[["format"], "onnx", 'format: expected "ludus-policy", got "onnx"'],
		[["version"], 2, "version: expected 1"],
		[["layers"], [], "layers: expected 1 to 64 items"],
		[["layers"], 3, "layers: expected 1 to 64 items"],
		[["images"], null, "images: expected 0 to 0 items"],
		[["policy"], 7, "policy: expected a text, got 7"],
		[["observation", 0, "dtype"], "float64", "observation[0].dtype: expected one of float32"],
		[["observation", 0, "shape"], [0], "observation[0].shape: expected positive sizes"],
		[["observation", 0, "shape"], [1e9, 1e9], "observation[0].shape: expected sizes"],
		[["observation", 0, "shape"], [4], "normalisation.shift.shape: expected [4], got [3]"],
		[["normalisation", "limit"], 0.0, "normalisation.limit: expected a positive number"],
		[["action", 0, "n"], 5, "layers: expected 6 outputs, got 5"],
		[["action", 0, "n"], 1.5, "action[0].n: expected an integer from 1 to"],
		[["action", 1, "low"], [0, 0], "action[1].low: expected 1 numbers, got 2"],
		[["memory", "kind"], "lstm", "memory.kind: expected one of gru"],
		[["memory"], [], "memory: expected an object, got Array"],
		[["layers", 0, "activation"], "gelu", "layers[0].activation: expected one of none, tanh"],
		[["layers", 0, "weight", "shape"], [5], "layers[0].weight.shape: expected [any, 6]"],
		[["layers", 0, "bias", "data"], "AAAA", "layers[0].bias.data: expected 20 bytes"],
		[["layers", 0, "bias", "data"], "A", "layers[0].bias.data: expected 20 bytes"],
		[["distribution", "log_std", "data"], NAN_DATA, "number 0 is not finite"],
		[["distribution", "log_std_range"], [2, -20], "log_std_range: expected [lowest, highest]"],
		[["distribution", "is_squashed"], "no", "is_squashed: expected true or false"],
	]
	for mistake in mistakes:
		var content := _content("gru")
		_set_at(content, mistake[0], mistake[1])
		var error: String = LudusPolicyReader.new(content).error
		check(str(mistake[2]) in error, "%s: %s" % [mistake[2], error])


func test_a_missing_field_is_named() -> void:
	for key in _content("gru"):
		var content := _content("gru")
		content.erase(key)
		var error: String = LudusPolicyReader.new(content).error
		if key == "frames":
			equal(error, "", "files from before there were frames")
		else:
			check(error.begins_with(key + ": missing"), "%s: %s" % [key, error])


func test_mistakes_in_convolutions_are_named() -> void:
	var where := ["images", 0, "convolutions", 1]
	var mistakes: Array = [
		[["stride"], 0, "images[0].convolutions[1].stride: expected an integer"],
		[["padding"], 3, "images[0].convolutions[1].padding: expected 0 to less"],
		[["weight", "shape"], [7, 6, 3, 3], "images[0].convolutions[1].weight.shape: expected"],
		[["stride"], 9, "images[0].linear.weight.shape: expected [any, 7], got [9, 63]"],
	]
	for mistake in mistakes:
		var content := _content("camera")
		_set_at(content, where + mistake[0], mistake[1])
		var error: String = LudusPolicyReader.new(content).error
		check(str(mistake[2]) in error, "%s: %s" % [mistake[2], error])


func test_files_that_are_none() -> void:
	check("cannot read" in LudusPolicy.load_file("/no/such/file.ludus.json").error, "no file")
	var path := "user://broken.ludus.json"
	for text in ["", "{", "[]", "7"]:
		_write(path, text)
		var policy: LudusPolicy = LudusPolicy.load_file(path)
		check(not policy.error.empty(), "'%s' is accepted" % text)
		check(policy.network() == null, "'%s' has a network" % text)
	equal(Directory.new().remove(path), OK, "remove")
	equal(LudusPolicy.new().error, "no model is chosen", "an empty policy")


func test_a_file_in_the_project() -> void:
	var path := "res://tests/.policy.ludus.json"
	equal(Directory.new().copy(_path("squashed"), path), OK, "copy")
	var policy: LudusPolicy = LudusPolicy.load_file(path)
	equal(policy.error, "", "error")
	equal(policy.policy_name, "squashed", "name")
	equal(Directory.new().remove(path), OK, "remove")


func test_a_policy_is_saved_as_a_resource() -> void:
	var path := "user://gru.tres"
	equal(ResourceSaver.save(path, LudusPolicy.load_file(_path("gru"))), OK, "save")
	var policy := ResourceLoader.load(path, "", true) as LudusPolicy
	equal(policy.model, _path("gru"), "model")
	equal(policy.policy_name, "gru", "name")
	equal(Directory.new().remove(path), OK, "remove")


func test_another_model_is_read_anew() -> void:
	var policy: LudusPolicy = LudusPolicy.load_file(_path("gru"))
	equal(policy.network().num_outputs, 5, "outputs")
	policy.model = _path("perceptron_tanh")
	equal(policy.network().num_outputs, 3, "outputs")
	equal(policy.policy_name, "perceptron_tanh", "name")


func _path(name: String) -> String:
	return golden_folder.plus_file("policies").plus_file(name + ".ludus.json")


func _content(name: String) -> Dictionary:
	var file := File.new()
	equal(file.open(_path(name), File.READ), OK, name)
	return JSON.parse(file.get_as_text()).result


func _write(path: String, text: String) -> void:
	var file := File.new()
	equal(file.open(path, File.WRITE), OK, path)
	file.store_string(text)
	file.close()


func _set_at(content, keys: Array, value) -> void:
	var part = content
	for i in keys.size() - 1:
		part = part[keys[i]]
	part[keys[-1]] = value
