extends "ludus_test.gd"
## What is wrong with a policy file is said, with its place.

const LudusPolicyReader := preload("res://addons/ludus/policy/policy_reader.gd")

const NAN_DATA := "AADAfw=="


func test_a_right_file() -> void:
	var read := LudusPolicyReader.new(_content("gru"))
	equal(read.error, "", "error")
	equal(read.entries[0].shape, PackedInt32Array([3]), "shape")
	equal(read.fingerprint.length(), 64, "fingerprint")


func test_mistakes_are_named() -> void:
	var mistakes: Array[Array] = [
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
	for mistake: Array in mistakes:
		var content := _content("gru")
		_set_at(content, mistake[0], mistake[1])
		var error := LudusPolicyReader.new(content).error
		check(str(mistake[2]) in error, "%s: %s" % [mistake[2], error])


func test_a_missing_field_is_named() -> void:
	for key: String in _content("gru"):
		var content := _content("gru")
		content.erase(key)
		var error := LudusPolicyReader.new(content).error
		if key == "frames":
			equal(error, "", "files from before there were frames")
		else:
			check(error.begins_with(key + ": missing"), "%s: %s" % [key, error])


func test_mistakes_in_convolutions_are_named() -> void:
	var where := ["images", 0, "convolutions", 1]
	var mistakes: Array[Array] = [
		[["stride"], 0, "images[0].convolutions[1].stride: expected an integer"],
		[["padding"], 3, "images[0].convolutions[1].padding: expected 0 to less"],
		[["weight", "shape"], [7, 6, 3, 3], "images[0].convolutions[1].weight.shape: expected"],
		[["stride"], 9, "images[0].linear.weight.shape: expected [any, 7], got [9, 63]"],
	]
	for mistake: Array in mistakes:
		var content := _content("camera")
		_set_at(content, where + mistake[0], mistake[1])
		var error := LudusPolicyReader.new(content).error
		check(str(mistake[2]) in error, "%s: %s" % [mistake[2], error])


func test_files_that_are_none() -> void:
	check("cannot read" in LudusPolicy.load_file("/no/such/file.ludus.json").error, "no file")
	var path := "user://broken.ludus.json"
	for text: String in ["", "{", "[]", "7"]:
		FileAccess.open(path, FileAccess.WRITE).store_string(text)
		var policy := LudusPolicy.load_file(path)
		check(not policy.error.is_empty(), "'%s' is accepted" % text)
		check(policy.network() == null, "'%s' has a network" % text)
	DirAccess.remove_absolute(path)
	equal(LudusPolicy.new().error, "no model is chosen", "an empty policy")


func test_a_file_in_the_project() -> void:
	var path := "res://tests/.policy.ludus.json"
	DirAccess.copy_absolute(_path("squashed"), ProjectSettings.globalize_path(path))
	var policy := LudusPolicy.load_file(path)
	equal(policy.error, "", "error")
	equal(policy.policy_name, "squashed", "name")
	check(policy.model.resource_path == path, "it is a resource of the project")
	DirAccess.remove_absolute(ProjectSettings.globalize_path(path))


func test_another_model_is_read_anew() -> void:
	var policy := LudusPolicy.load_file(_path("gru"))
	equal(policy.network().num_outputs, 5, "outputs")
	policy.model = LudusPolicy.load_file(_path("perceptron_tanh")).model
	equal(policy.network().num_outputs, 3, "outputs")
	equal(policy.policy_name, "perceptron_tanh", "name")


func _path(name: String) -> String:
	return golden_folder.path_join("policies").path_join(name + ".ludus.json")


func _content(name: String) -> Dictionary:
	return JSON.parse_string(FileAccess.get_file_as_string(_path(name)))


func _set_at(content: Variant, keys: Array, value: Variant) -> void:
	var part: Variant = content
	for key: Variant in keys.slice(0, -1):
		part = part[key]
	part[keys[-1]] = value
