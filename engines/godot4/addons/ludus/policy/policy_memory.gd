extends RefCounted
## The gated recurrent unit of a policy (POLICY.md §3), for many rows at once.
##
## A sigmoid is [code]0.5 * tanh(0.5 * x) + 0.5[/code]; the inner half is folded into the weights.

const LudusPolicyDense := preload("res://addons/ludus/policy/policy_dense.gd")

const HALVES := Vector4(0.5, 0.5, 0.5, 0.5)

## Blocks of a state.
var num_blocks: int = 0

var _from_input: LudusPolicyDense
var _from_state: LudusPolicyDense
var _state: PackedVector4Array = []
var _input_gates: PackedVector4Array = []
var _state_gates: PackedVector4Array = []


## Takes the arrays of the policy file; [param columns] are the places of the inputs.
func _init(
	weight_input: PackedFloat32Array,
	weight_hidden: PackedFloat32Array,
	bias_input: PackedFloat32Array,
	bias_hidden: PackedFloat32Array,
	columns: PackedInt32Array
) -> void:
	var size := bias_input.size() / 3
	num_blocks = (size + 3) / 4
	var rows := LudusPolicyDense.spread([size, size, size])
	var own := LudusPolicyDense.spread([size])
	_from_input = LudusPolicyDense.new(_halved(weight_input), _halved(bias_input), rows, columns)
	_from_state = LudusPolicyDense.new(_halved(weight_hidden), _halved(bias_hidden), rows, own)


## Gives room for [param num_rows] rows.
func reserve(num_rows: int) -> void:
	_state.resize(num_rows * num_blocks)
	_input_gates.resize(num_rows * num_blocks * 3)
	_state_gates.resize(num_rows * num_blocks * 3)


## Turns inputs [param x] and the states of [param slots] into new states, which stand in
## [param states] again, by slot, and in [param y], one row after the other.
func advance(
	x: PackedVector4Array,
	slots: PackedInt32Array,
	states: PackedVector4Array,
	y: PackedVector4Array
) -> void:
	var num_rows := slots.size()
	for row: int in num_rows:
		for i: int in num_blocks:
			_state[row * num_blocks + i] = states[slots[row] * num_blocks + i]
	_from_input.apply(x, _input_gates, num_rows)
	_from_state.apply(_state, _state_gates, num_rows)
	for row: int in num_rows:
		_combine(row)
		for i: int in num_blocks:
			var state := _state[row * num_blocks + i]
			y[row * num_blocks + i] = state
			states[slots[row] * num_blocks + i] = state


## Replaces one row of the state by the next one.
func _combine(row: int) -> void:
	var reset := row * num_blocks * 3
	var update := reset + num_blocks
	var new := update + num_blocks
	for i: int in range(reset, new):
		_input_gates[i] += _state_gates[i]
	LudusPolicyDense.activate(LudusPolicyDense.TANH, _input_gates, reset, new)
	for i: int in num_blocks:
		var share := _input_gates[reset + i] * HALVES + HALVES
		_input_gates[new + i] += share * _state_gates[new + i]
	LudusPolicyDense.activate(LudusPolicyDense.TANH, _input_gates, new, new + num_blocks)
	for i: int in num_blocks:
		var candidate := _input_gates[new + i]
		var kept := _input_gates[update + i] * HALVES + HALVES
		var old := _state[row * num_blocks + i]
		_state[row * num_blocks + i] = candidate + kept * (old - candidate)


## The first two thirds, the rows of both sigmoids, halved.
static func _halved(numbers: PackedFloat32Array) -> PackedFloat32Array:
	var halved := numbers.duplicate()
	for i: int in numbers.size() / 3 * 2:
		halved[i] *= 0.5
	return halved
