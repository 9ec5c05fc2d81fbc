extends RefCounted
## The network of a policy: from observations of many agents to the numbers that say what to do.
##
## Nothing is allocated once the buffers are large enough, but for images.

const LudusPolicyDense := preload("res://addons/ludus/policy/policy_dense.gd")
const LudusPolicyMemory := preload("res://addons/ludus/policy/policy_memory.gd")
const LudusPolicyReader := preload("res://addons/ludus/policy/policy_reader.gd")
const LudusPolicyVision := preload("res://addons/ludus/policy/policy_vision.gd")

## Numbers that are put out per agent.
var num_outputs: int = 0
## Blocks of an agent's memory; 0 without one.
var memory_blocks: int = 0
## Networks of the image entries.
var visions: Array[LudusPolicyVision] = []
## What [method run] put out, [member num_outputs] for each row.
var outputs: PackedFloat32Array = []
## Whether all numbers that [method run] saw were numbers, and not NaN or infinite.
var is_input_finite: bool = true

var _entries: Array[LudusObservationEntry] = []
## Elements of each vector entry, and where its blocks begin.
var _sizes: PackedInt32Array = []
var _starts: PackedInt32Array = []
## Blocks of a row of features.
var _num_blocks: int = 0
var _shift: PackedVector4Array = []
var _scale: PackedVector4Array = []
var _limit: Vector4
var _memory: LudusPolicyMemory
var _layers: Array[LudusPolicyDense] = []
var _capacity: int = 0
var _features: PackedVector4Array = []
var _state: PackedVector4Array = []
## What each layer puts out.
var _results: Array[PackedVector4Array] = []


## Packs what was read.
func _init(read: LudusPolicyReader) -> void:
	_entries = read.entries
	_sizes = read.vector_sizes()
	for size: int in _sizes:
		_starts.append(_num_blocks)
		_num_blocks += (size + 3) / 4
	_pack_normalisation(read)
	var seen := read.entries.filter(LudusPolicyReader.is_image)
	for i: int in read.images.size():
		var entry: LudusObservationEntry = seen[i]
		var shape := PackedInt32Array([read.frames]) + entry.shape
		visions.append(LudusPolicyVision.new(read.images[i], shape))
		_num_blocks += (visions[i].num_features + 3) / 4
	var columns := LudusPolicyDense.spread(read.feature_sizes())
	if not read.memory.is_empty():
		columns = _pack_memory(read.memory, columns)
	for layer: Dictionary in read.layers:
		num_outputs = (layer["bias"] as PackedFloat32Array).size()
		var rows := LudusPolicyDense.spread([num_outputs])
		_layers.append(
			LudusPolicyDense.new(layer["weight"], layer["bias"], rows, columns, layer["activation"])
		)
		_results.append(PackedVector4Array())
		columns = rows


## Computes [member outputs] for the agents of some slots, one row for each.[br]
## [param observed]: for each entry its bytes for all slots, all frames of a slot together.[br]
## [param states]: [member memory_blocks] for each slot, replaced by the next ones.
func run(
	slots: PackedInt32Array, observed: Array[PackedByteArray], states: PackedVector4Array
) -> void:
	_reserve(slots.size())
	var images: Array[PackedByteArray] = []
	var vector := 0
	for i: int in _entries.size():
		if LudusPolicyReader.is_image(_entries[i]):
			images.append(observed[i])
			continue
		_fill(_floats(observed[i], _entries[i].dtype), _sizes[vector], _starts[vector], slots)
		vector += 1
	var sum := Vector4.ZERO
	for i: int in slots.size() * _num_blocks:
		sum += _features[i]
	is_input_finite = sum.is_finite()
	if not _scale.is_empty():
		_normalise(slots.size())
	_look(images, slots)
	var x := _features
	if _memory != null:
		_memory.advance(x, slots, states, _state)
		x = _state
	for i: int in _layers.size():
		_layers[i].apply(x, _results[i], slots.size())
		x = _results[i]
	_unpack(x, slots.size(), _layers[-1].num_out)


func _pack_normalisation(read: LudusPolicyReader) -> void:
	if read.scale.is_empty():
		return
	var places := LudusPolicyDense.spread(_sizes)
	for block: int in places.size() / 4:
		var shift := Vector4.ZERO
		var scale := Vector4.ZERO
		for i: int in 4:
			var place := places[block * 4 + i]
			if place >= 0:
				shift[i] = read.shift[place]
				scale[i] = read.scale[place]
		_shift.append(shift)
		_scale.append(scale)
	_limit = Vector4(read.limit, read.limit, read.limit, read.limit)


## Returns the places of the numbers of a state.
func _pack_memory(memory: Dictionary, columns: PackedInt32Array) -> PackedInt32Array:
	_memory = LudusPolicyMemory.new(
		memory["weight_input"],
		memory["weight_hidden"],
		memory["bias_input"],
		memory["bias_hidden"],
		columns
	)
	memory_blocks = _memory.num_blocks
	return LudusPolicyDense.spread([(memory["bias_input"] as PackedFloat32Array).size() / 3])


func _reserve(num_rows: int) -> void:
	outputs.resize(num_rows * num_outputs)
	if num_rows <= _capacity:
		return
	_capacity = num_rows
	_features.resize(num_rows * _num_blocks)
	_state.resize(num_rows * memory_blocks)
	for i: int in _layers.size():
		_results[i].resize(num_rows * _layers[i].num_out)
	if _memory != null:
		_memory.reserve(num_rows)


static func _floats(
	bytes: PackedByteArray, dtype: LudusObservationEntry.DType
) -> PackedFloat32Array:
	match dtype:
		LudusObservationEntry.DType.UINT8:
			return PackedFloat32Array(Array(bytes))
		LudusObservationEntry.DType.INT64:
			return PackedFloat32Array(Array(bytes.to_int64_array()))
	return bytes.to_float32_array()


## Puts the numbers of one entry into the rows.
func _fill(numbers: PackedFloat32Array, size: int, start: int, slots: PackedInt32Array) -> void:
	var target := start
	for slot: int in slots:
		var from := slot * size
		var last := from + size - 3
		var to := target
		while from < last:
			_features[to] = Vector4(
				numbers[from], numbers[from + 1], numbers[from + 2], numbers[from + 3]
			)
			from += 4
			to += 1
		if size & 3 != 0:
			var tail := Vector4.ZERO
			for i: int in size & 3:
				tail[i] = numbers[from + i]
			_features[to] = tail
		target += _num_blocks


func _normalise(num_rows: int) -> void:
	var low := -_limit
	for row: int in num_rows:
		var first := row * _num_blocks
		for i: int in _scale.size():
			var shifted := (_features[first + i] - _shift[i]) * _scale[i]
			_features[first + i] = shifted.clamp(low, _limit)


func _look(images: Array[PackedByteArray], slots: PackedInt32Array) -> void:
	var target := _starts[-1] + (_sizes[-1] + 3) / 4 if not _sizes.is_empty() else 0
	for i: int in visions.size():
		for row: int in slots.size():
			visions[i].apply(images[i], slots[row], _features, row * _num_blocks + target)
		target += (visions[i].num_features + 3) / 4


func _unpack(y: PackedVector4Array, num_rows: int, num_blocks: int) -> void:
	var target := 0
	for row: int in num_rows:
		var from := row * num_blocks
		for i: int in num_outputs:
			outputs[target] = y[from + (i >> 2)][i & 3]
			target += 1
