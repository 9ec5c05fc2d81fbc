class_name LudusPolicyNetwork
extends Reference
## The network of a policy: from observations of many agents to the numbers that say what to do.

## Numbers that are put out per agent.
var num_outputs: int = 0
## Blocks of an agent's memory; 0 without one.
var memory_blocks: int = 0
## Networks of the image entries ([LudusPolicyVision]).
var visions: Array = []
## What [method run] put out, [member num_outputs] for each row.
var outputs: Array = []
## Whether all numbers that [method run] saw were numbers, and not NaN or infinite.
var is_input_finite: bool = true

## Elements of each vector entry.
var _sizes: Array = []
var _num_features: int = 0
var _shift: Array = []
var _scale: Array = []
var _limit: float
var _memory: LudusPolicyMemory
var _layers: Array = []
var _capacity: int = 0
var _features: Array = []
var _state: Array = []
## What each layer puts out.
var _results: Array = []


## Packs what was read.
func _init(read: LudusPolicyReader) -> void:
	_sizes = read.vector_sizes()
	_shift = read.shift
	_scale = read.scale
	_limit = read.limit
	for size in read.feature_sizes():
		_num_features += size
	for image in read.images:
		visions.append(LudusPolicyVision.new(image))
	if not read.memory.empty():
		_memory = LudusPolicyMemory.new(
			read.memory["weight_input"],
			read.memory["weight_hidden"],
			read.memory["bias_input"],
			read.memory["bias_hidden"]
		)
		memory_blocks = _memory.num_blocks
	for layer in read.layers:
		num_outputs = layer["bias"].size()
		_layers.append(LudusPolicyDense.new(layer["weight"], layer["bias"], layer["activation"]))
		_results.append([])


## Computes [member outputs] for the agents of some slots, one row for each.
##
## [param vectors]: for each entry but images, in order, its numbers for all slots.
## [param images]: for each image entry its bytes for all slots.
## Both hold all frames of a slot, see [LudusPolicyFrames].
## [param states]: [member memory_blocks] for each slot, replaced by the next ones.
func run(slots: Array, vectors: Array, images: Array, states: Array) -> void:
	_reserve(slots.size())
	is_input_finite = true
	for row in slots.size():
		_fill(row, slots[row], vectors, images)
	var x := _features
	if _memory != null:
		_memory.advance(x, slots, states, _state)
		x = _state
	for i in _layers.size():
		_layers[i].apply(x, _results[i], slots.size())
		x = _results[i]
	_unpack(x, slots.size(), _layers[-1].num_out)


func _reserve(num_rows: int) -> void:
	outputs.resize(num_rows * num_outputs)
	if num_rows <= _capacity:
		return
	_capacity = num_rows
	_features.resize(num_rows * LudusPolicyDense.num_blocks(_num_features))
	_state.resize(num_rows * memory_blocks)
	for i in _layers.size():
		_results[i].resize(num_rows * _layers[i].num_out)
	if _memory != null:
		_memory.reserve(num_rows)


## Puts what one slot sees into a row of features.
func _fill(row: int, slot: int, vectors: Array, images: Array) -> void:
	var numbers := []
	for i in _sizes.size():
		var size: int = _sizes[i]
		numbers.append_array(vectors[i].slice(slot * size, slot * size + size - 1))
	var sum := 0.0
	for number in numbers:
		sum += number
	is_input_finite = is_input_finite and not (is_nan(sum) or is_inf(sum))
	for i in _scale.size():
		numbers[i] = clamp((numbers[i] - _shift[i]) * _scale[i], -_limit, _limit)
	for i in visions.size():
		numbers.append_array(visions[i].features(images[i], slot))
	var num_blocks := LudusPolicyDense.num_blocks(_num_features)
	for i in num_blocks:
		_features[row * num_blocks + i] = LudusPolicyDense.block(numbers, i * 3, _num_features)


func _unpack(y: Array, num_rows: int, num_blocks: int) -> void:
	var target := 0
	for row in num_rows:
		var from: int = row * num_blocks
		for i in num_outputs:
			outputs[target] = y[from + i / 3][i % 3]
			target += 1
