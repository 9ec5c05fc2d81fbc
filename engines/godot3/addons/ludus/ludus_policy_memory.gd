class_name LudusPolicyMemory
extends Reference
## The gated recurrent unit of a policy (POLICY.md §3), for many rows at once.
##
## A sigmoid is [code]0.5 * tanh(0.5 * x) + 0.5[/code]; the inner half is folded into the weights.

const HALVES := Vector3(0.5, 0.5, 0.5)

## Blocks of a state.
var num_blocks: int = 0

var _from_input: LudusPolicyDense
var _from_state: LudusPolicyDense
var _state: Array = []
var _input_gates: Array = []
var _state_gates: Array = []


## Takes the arrays of the policy file.
func _init(
	weight_input: Array, weight_hidden: Array, bias_input: Array, bias_hidden: Array
) -> void:
	var size := bias_input.size() / 3
	num_blocks = LudusPolicyDense.num_blocks(size)
	_from_input = LudusPolicyDense.new(_gates(weight_input, size), _gates(bias_input, size))
	_from_state = LudusPolicyDense.new(_gates(weight_hidden, size), _gates(bias_hidden, size))


## Gives room for [param num_rows] rows.
func reserve(num_rows: int) -> void:
	_state.resize(num_rows * num_blocks)
	_input_gates.resize(num_rows * num_blocks * 3)
	_state_gates.resize(num_rows * num_blocks * 3)


## Turns inputs [param x] and the states of [param slots] into new states, which stand in
## [param states] again, by slot, and in [param y], one row after the other.
func advance(x: Array, slots: Array, states: Array, y: Array) -> void:
	var num_rows := slots.size()
	for row in num_rows:
		for i in num_blocks:
			_state[row * num_blocks + i] = states[slots[row] * num_blocks + i]
	_from_input.apply(x, _input_gates, num_rows)
	_from_state.apply(_state, _state_gates, num_rows)
	for row in num_rows:
		_combine(row)
		for i in num_blocks:
			var state: Vector3 = _state[row * num_blocks + i]
			y[row * num_blocks + i] = state
			states[slots[row] * num_blocks + i] = state


## Replaces one row of the state by the next one.
func _combine(row: int) -> void:
	var reset := row * num_blocks * 3
	var update := reset + num_blocks
	var new := update + num_blocks
	for i in range(reset, new):
		_input_gates[i] += _state_gates[i]
	LudusPolicyDense.activate(LudusPolicyDense.TANH, _input_gates, reset, new)
	for i in num_blocks:
		var share: Vector3 = _input_gates[reset + i] * HALVES + HALVES
		_input_gates[new + i] += share * _state_gates[new + i]
	LudusPolicyDense.activate(LudusPolicyDense.TANH, _input_gates, new, new + num_blocks)
	for i in num_blocks:
		var candidate: Vector3 = _input_gates[new + i]
		var kept: Vector3 = _input_gates[update + i] * HALVES + HALVES
		var old: Vector3 = _state[row * num_blocks + i]
		_state[row * num_blocks + i] = candidate + kept * (old - candidate)


## The rows of the three gates, the first two halved for their sigmoids, with rows of zeros after
## each, so that every gate begins a new block.
static func _gates(numbers: Array, size: int) -> Array:
	var columns := numbers.size() / (size * 3)
	var num_zeros := (LudusPolicyDense.num_blocks(size) * 3 - size) * columns
	var rows := []
	for gate in 3:
		var factor := 0.5 if gate < 2 else 1.0
		for i in range(gate * size * columns, (gate + 1) * size * columns):
			rows.append(numbers[i] * factor)
		for _i in num_zeros:
			rows.append(0.0)
	return rows
