class_name NeuralNetwork
extends RefCounted
## The network of a policy file of godot-ai: dense layers with ReLU between them, packed once and
## computed by [LudusPolicyDense].

const LudusPolicyDense := preload("res://addons/ludus/policy/policy_dense.gd")

var _weights: Array
var _biases: Array
var _layers: Array[LudusPolicyDense] = []
## What each layer puts out.
var _results: Array[PackedVector4Array] = []


## Takes a matrix, a list of rows, and a list of biases for each layer.
func _init(weights: Array, biases: Array) -> void:
	_weights = weights
	_biases = biases
	if weights.is_empty() or weights.size() != biases.size():
		push_error(
			(
				"ludus: NeuralNetwork needs as many weights as biases, got %d and %d"
				% [weights.size(), biases.size()]
			)
		)
		return
	for i: int in weights.size():
		var is_last := i == weights.size() - 1
		_add_layer(
			weights[i], biases[i], LudusPolicyDense.NONE if is_last else LudusPolicyDense.RELU
		)


## Returns what the last layer puts out; empty, with an error, if [param input] does not fit.
func feed_forward(input: Array[float]) -> Array[float]:
	var output: Array[float] = []
	if _layers.is_empty() or input.size() != (_weights[0][0] as Array).size():
		push_error("ludus: NeuralNetwork: an input of %d numbers does not fit" % input.size())
		return output
	var x := _packed(input)
	for i: int in _layers.size():
		_layers[i].apply(x, _results[i], 1)
		x = _results[i]
	for i: int in (_biases[-1] as Array).size():
		output.append(x[i >> 2][i & 3])
	return output


func _add_layer(weight: Array, bias: Array, activation: int) -> void:
	var numbers := PackedFloat32Array()
	for row: Array in weight:
		numbers.append_array(PackedFloat32Array(row))
	var rows := LudusPolicyDense.spread([bias.size()])
	var columns := LudusPolicyDense.spread([numbers.size() / bias.size()])
	_layers.append(
		LudusPolicyDense.new(numbers, PackedFloat32Array(bias), rows, columns, activation)
	)
	var result := PackedVector4Array()
	result.resize(rows.size() / 4)
	_results.append(result)


static func _packed(input: Array[float]) -> PackedVector4Array:
	var blocks := PackedVector4Array()
	blocks.resize((input.size() + 3) / 4)
	for i: int in input.size():
		var block := blocks[i >> 2]
		block[i & 3] = input[i]
		blocks[i >> 2] = block
	return blocks
