extends RefCounted
## A dense layer of a policy by blocks of 4 × 4 weights, for many rows at once.
##
## Rows are [PackedVector4Array]s, four numbers to a block, with zeros in the unused places of a
## block. A [Projection] times a [Vector4] is sixteen multiply-adds in one call of the engine, a
## [Projection] times a [Projection] does it for four rows.

## Non-linearities (POLICY.md §3).
const ACTIVATIONS: PackedStringArray = ["none", "tanh", "relu", "elu", "silu"]
const NONE := 0
const TANH := 1
const RELU := 2
const ELU := 3
const SILU := 4

const ONES := Vector4(1.0, 1.0, 1.0, 1.0)

## Blocks of an input row.
var num_in: int = 0
## Blocks of an output row.
var num_out: int = 0

var _weights: Array[Projection] = []
var _biases: PackedVector4Array = []
var _activation: int = NONE
## Four rows side by side: a projection per input block.
var _four: Array[Projection] = []


## Packs [param weight], a matrix of [code]bias.size()[/code] rows. Places of rows and columns in
## their blocks come from [method spread] or are made like it.
func _init(
	weight: PackedFloat32Array,
	bias: PackedFloat32Array,
	rows: PackedInt32Array,
	columns: PackedInt32Array,
	activation: int = NONE
) -> void:
	num_out = rows.size() / 4
	num_in = columns.size() / 4
	_activation = activation
	_four.resize(num_in)
	for out: int in num_out:
		var biases := Vector4.ZERO
		for i: int in 4:
			if rows[out * 4 + i] >= 0:
				biases[i] = bias[rows[out * 4 + i]]
		_biases.append(biases)
		for block: int in num_in:
			_weights.append(_pack(weight, bias.size(), rows, columns, out * 4, block * 4))


## Returns the place of every number when parts of these [param sizes] each begin a new block: its
## index among all numbers, or -1 in the unused places.
static func spread(sizes: PackedInt32Array) -> PackedInt32Array:
	var places := PackedInt32Array()
	var next := 0
	for size: int in sizes:
		for i: int in (size + 3) / 4 * 4:
			places.append(next + i if i < size else -1)
		next += size
	return places


## Returns the blocks that the bytes of floats stand for. Older engines have no
## [code]to_vector4_array()[/code], but read back what [method @GlobalScope.var_to_bytes] writes:
## the type, the count, the numbers.
static func vectors(bytes: PackedByteArray) -> PackedVector4Array:
	var encoded := PackedByteArray()
	encoded.resize(8)
	encoded.encode_u32(0, TYPE_PACKED_VECTOR4_ARRAY)
	encoded.encode_u32(4, bytes.size() / 16)
	encoded.append_array(bytes)
	return bytes_to_var(encoded)


## Computes [param num_rows] rows of [param y] from those of [param x].
func apply(x: PackedVector4Array, y: PackedVector4Array, num_rows: int) -> void:
	var row := 0
	while row + 4 <= num_rows:
		_apply_to_four(x, y, row)
		row += 4
	while row < num_rows:
		_apply_to_one(x, y, row)
		row += 1
	if _activation != NONE:
		activate(_activation, y, 0, num_rows * num_out)


## Applies a non-linearity to some blocks in place.
static func activate(activation: int, y: PackedVector4Array, from: int, to: int) -> void:
	match activation:
		TANH:
			for i: int in range(from, to):
				var v := y[i]
				y[i] = Vector4(tanh(v.x), tanh(v.y), tanh(v.z), tanh(v.w))
		RELU:
			for i: int in range(from, to):
				y[i] = y[i].max(Vector4.ZERO)
		ELU:
			for i: int in range(from, to):
				var v := y[i].min(Vector4.ZERO)
				var low := Vector4(exp(v.x), exp(v.y), exp(v.z), exp(v.w)) - ONES
				y[i] = y[i].max(Vector4.ZERO) + low
		SILU:
			for i: int in range(from, to):
				var v := y[i] * 0.5
				y[i] = v * (Vector4(tanh(v.x), tanh(v.y), tanh(v.z), tanh(v.w)) + ONES)


func _apply_to_one(x: PackedVector4Array, y: PackedVector4Array, row: int) -> void:
	var first := row * num_in
	var last := first + num_in
	var target := row * num_out
	var k := 0
	for out: int in num_out:
		var sum := _biases[out]
		for i: int in range(first, last):
			sum += _weights[k] * x[i]
			k += 1
		y[target + out] = sum


func _apply_to_four(x: PackedVector4Array, y: PackedVector4Array, row: int) -> void:
	var first := row * num_in
	for i: int in num_in:
		_four[i] = Projection(
			x[first + i],
			x[first + num_in + i],
			x[first + num_in * 2 + i],
			x[first + num_in * 3 + i]
		)
	var target := row * num_out
	var k := 0
	for out: int in num_out:
		var sum_0 := _biases[out]
		var sum_1 := sum_0
		var sum_2 := sum_0
		var sum_3 := sum_0
		for inputs: Projection in _four:
			var products := _weights[k] * inputs
			sum_0 += products.x
			sum_1 += products.y
			sum_2 += products.z
			sum_3 += products.w
			k += 1
		y[target + out] = sum_0
		y[target + num_out + out] = sum_1
		y[target + num_out * 2 + out] = sum_2
		y[target + num_out * 3 + out] = sum_3


## One block of weights; the columns of a projection are those of the matrix.
static func _pack(
	weight: PackedFloat32Array,
	num_rows: int,
	rows: PackedInt32Array,
	columns: PackedInt32Array,
	top: int,
	left: int
) -> Projection:
	var stride := weight.size() / num_rows
	var block := Projection(Vector4.ZERO, Vector4.ZERO, Vector4.ZERO, Vector4.ZERO)
	for j: int in 4:
		var column := columns[left + j]
		if column < 0:
			continue
		var numbers := Vector4.ZERO
		for i: int in 4:
			if rows[top + i] >= 0:
				numbers[i] = weight[rows[top + i] * stride + column]
		block[j] = numbers
	return block
