class_name LudusPolicyDense
extends Reference
## A dense layer of a policy by blocks of 3 × 3 weights, for many rows at once.
##
## Rows are arrays of [Vector3], three numbers to a block, with zeros in the unused places of the
## last block. A [Basis] times a [Vector3] is nine multiply-adds in one call of the engine. Arrays
## are handed on by reference; pool arrays would be copied.

## Non-linearities (POLICY.md §3).
const ACTIVATIONS := ["none", "tanh", "relu", "elu", "silu"]
const NONE := 0
const TANH := 1
const RELU := 2
const ELU := 3
const SILU := 4

## Blocks of an input row.
var num_in: int = 0
## Blocks of an output row.
var num_out: int = 0

## For each output block the [Basis] of every input block.
var _weights: Array = []
var _biases: Array = []
var _activation: int = NONE


## Packs [param weight], a matrix of [code]bias.size()[/code] rows.
func _init(weight: Array, bias: Array, activation: int = NONE) -> void:
	var num_rows := bias.size()
	var num_columns := weight.size() / num_rows
	num_out = num_blocks(num_rows)
	num_in = num_blocks(num_columns)
	_activation = activation
	for out in num_out:
		_biases.append(block(bias, out * 3, num_rows))
		var blocks := []
		for i in num_in:
			blocks.append(_pack(weight, num_rows, num_columns, out * 3, i * 3))
		_weights.append(blocks)


## Number of blocks that [param count] numbers fill.
static func num_blocks(count: int) -> int:
	return (count + 2) / 3


## The block of the numbers from [param from] on, of which those from [param end] on are zero.
static func block(numbers: Array, from: int, end: int) -> Vector3:
	if from + 3 <= end:
		return Vector3(numbers[from], numbers[from + 1], numbers[from + 2])
	return Vector3(numbers[from], numbers[from + 1] if from + 1 < end else 0.0, 0.0)


## Computes [param num_rows] rows of [param y] from those of [param x].
func apply(x: Array, y: Array, num_rows: int) -> void:
	var target := 0
	for row in num_rows:
		var inputs := x.slice(row * num_in, row * num_in + num_in - 1)
		for out in num_out:
			var weights: Array = _weights[out]
			var sum: Vector3 = _biases[out]
			for i in num_in:
				sum += weights[i] * inputs[i]
			y[target] = sum
			target += 1
	if _activation != NONE:
		activate(_activation, y, 0, target)


## Applies a non-linearity to some blocks in place.
static func activate(activation: int, y: Array, from: int, to: int) -> void:
	match activation:
		TANH:
			for i in range(from, to):
				var v: Vector3 = y[i]
				y[i] = Vector3(tanh(v.x), tanh(v.y), tanh(v.z))
		RELU:
			for i in range(from, to):
				var v: Vector3 = y[i]
				y[i] = Vector3(max(v.x, 0.0), max(v.y, 0.0), max(v.z, 0.0))
		ELU:
			for i in range(from, to):
				var v: Vector3 = y[i]
				y[i] = Vector3(_elu(v.x), _elu(v.y), _elu(v.z))
		SILU:
			for i in range(from, to):
				var v: Vector3 = y[i] * 0.5
				y[i] = v * (Vector3(tanh(v.x), tanh(v.y), tanh(v.z)) + Vector3.ONE)


static func _elu(number: float) -> float:
	return number if number > 0.0 else exp(number) - 1.0


## One block of weights; the columns of a basis are those of the matrix.
static func _pack(weight: Array, num_rows: int, num_columns: int, top: int, left: int) -> Basis:
	var columns := [Vector3.ZERO, Vector3.ZERO, Vector3.ZERO]
	for j in min(3, num_columns - left):
		var column := Vector3.ZERO
		for i in min(3, num_rows - top):
			column[i] = weight[(top + i) * num_columns + left + j]
		columns[j] = column
	return Basis(columns[0], columns[1], columns[2])
