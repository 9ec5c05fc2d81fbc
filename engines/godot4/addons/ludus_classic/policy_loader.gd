class_name PolicyLoader
extends RefCounted
## Reads the policy of an agent for a [NeuralNetwork]: [code]NAME_policy.json[/code], as godot-ai
## and [code]ludus serve --bridge godot-ai[/code] write it, or [code]NAME.ludus.json[/code], as
## the trainer of this add-on does. If both are there, the newer one.

const LudusPolicyDense := preload("res://addons/ludus/policy/policy_dense.gd")
const LudusPolicyReader := preload("res://addons/ludus/policy/policy_reader.gd")

const FOLDER := "AIServerCommFiles"

var _did_load_policy_data: bool = false
var _policy_weights: Array = []
var _policy_biases: Array = []


## Where godot-ai has the policy of an agent.
func get_policy_path(file_name: String) -> String:
	return "res://%s/%s_policy.json" % [FOLDER, file_name]


## Reads the policy of an agent, if there is one.
func try_to_load_policy_data(file_name: String) -> void:
	_did_load_policy_data = false
	_policy_weights.clear()
	_policy_biases.clear()
	var path := _newest(
		[
			get_policy_path(file_name),
			"res://%s/%s.ludus.json" % [FOLDER, file_name],
			"user://%s/%s.ludus.json" % [FOLDER, file_name],
		]
	)
	if path.is_empty():
		return
	var json := JSON.new()
	if json.parse(FileAccess.get_file_as_string(path)) != OK or json.data is not Dictionary:
		push_error("ludus: %s is no policy file: %s" % [path, json.get_error_message()])
	elif path.ends_with(".ludus.json"):
		_take_policy(json, path)
	else:
		_take_parameters(json.data, path)


static func _newest(paths: PackedStringArray) -> String:
	var newest := ""
	var time := -1
	for path: String in paths:
		if FileAccess.file_exists(path) and int(FileAccess.get_modified_time(path)) > time:
			newest = path
			time = FileAccess.get_modified_time(path)
	return newest


## Takes parameters by names such as [code]network.network.0.weight[/code], in the order of their
## numbers.
func _take_parameters(parameters: Dictionary, path: String) -> void:
	var numbers: Array[int] = []
	for key: String in parameters:
		if key.ends_with(".weight"):
			numbers.append(key.get_slice(".", key.get_slice_count(".") - 2).to_int())
	numbers.sort()
	for number: int in numbers:
		var weight: Variant = _find(parameters, "%d.weight" % number)
		var bias: Variant = _find(parameters, "%d.bias" % number)
		if weight is not Array or bias is not Array:
			push_error("ludus: %s: layer %d lacks weight or bias" % [path, number])
			return
		_policy_weights.append(weight)
		_policy_biases.append(bias)
	_did_load_policy_data = not numbers.is_empty()


static func _find(parameters: Dictionary, ending: String) -> Variant:
	for key: String in parameters:
		if key == ending or key.ends_with("." + ending):
			return parameters[key]
	return null


func _take_policy(json: JSON, path: String) -> void:
	var policy := LudusPolicy.new()
	policy.model = json
	var read := policy.reader()
	var problem := read.error if not read.error.is_empty() else _incompatibility(read)
	if not problem.is_empty():
		push_error("ludus: %s: %s; give it to a LudusPolicy instead" % [path, problem])
		return
	for layer: Dictionary in read.layers:
		_policy_weights.append(_rows(layer["weight"], layer["bias"]))
		_policy_biases.append(Array(layer["bias"] as PackedFloat32Array))
	_did_load_policy_data = true


## Why a policy is not of the one kind that godot-ai has; an empty text if it is.
static func _incompatibility(read: LudusPolicyReader) -> String:
	var is_plain := read.memory.is_empty() and read.images.is_empty() and read.scale.is_empty()
	if not is_plain or read.frames > 1:
		return "it is more than dense layers"
	if not read.is_squashed or not read.has_own_log_std or read.num_logits > 0:
		return "it is no squashed Gaussian"
	for i: int in read.layers.size():
		var is_last := i == read.layers.size() - 1
		var expected := LudusPolicyDense.NONE if is_last else LudusPolicyDense.RELU
		if read.layers[i]["activation"] != expected:
			return "it has other activations than ReLU"
	return ""


static func _rows(weight: PackedFloat32Array, bias: PackedFloat32Array) -> Array:
	var rows: Array = []
	var size := weight.size() / bias.size()
	for i: int in bias.size():
		rows.append(Array(weight.slice(i * size, (i + 1) * size)))
	return rows
