extends SceneTree
## Runs an exported policy on the observations of a parity test, see engines.py.
## Last argument: the folder with request.json and inputs.bin; answers.bin is written there.

const REQUEST := "request.json"
const INPUTS := "inputs.bin"
const ANSWERS := "answers.bin"
const BYTES_OF := {"float32": 4, "uint8": 1, "int64": 8}

var _num_agents: int
var _mask_size: int
var _entries: Array
var _policy: LudusPolicy
var _network: LudusPolicyNetwork
var _actions: LudusPolicyActions
var _slots: Array = []
var _states: Array = []


func _initialize() -> void:
	var folder: String = OS.get_cmdline_args()[-1]
	var request: Dictionary = JSON.parse(_open(folder, REQUEST, File.READ).get_as_text()).result
	var problem := _load(request)
	if not problem.empty():
		printerr("ludus: ", problem)
		quit(1)
		return
	var inputs := _open(folder, INPUTS, File.READ)
	var answers := _open(folder, ANSWERS, File.WRITE)
	for _step in int(request["num_steps"]):
		_answer(inputs, answers)
	answers.close()
	quit()


func _open(folder: String, name: String, mode: int) -> File:
	var file := File.new()
	if file.open(folder.plus_file(name), mode) != OK:
		printerr("ludus: cannot open ", folder.plus_file(name))
	return file


## Prepares the policy; says what is wrong with it.
func _load(request: Dictionary) -> String:
	_num_agents = request["num_agents"]
	_mask_size = request["mask_size"]
	_entries = request["entries"]
	_policy = LudusPolicy.load_file(request["policy"])
	if not _policy.get_error().empty():
		return _policy.get_error()
	_network = _policy.network()
	_actions = LudusPolicyActions.new(_policy.reader())
	_actions.reserve(_num_agents)
	_states.resize(_num_agents * _network.memory_blocks)
	_states.fill(Vector3.ZERO)
	_slots = range(_num_agents)
	return ""


## Answers one step.
func _answer(inputs: File, answers: File) -> void:
	var vectors := []
	var images := []
	for i in _entries.size():
		var dtype: String = _entries[i]["dtype"]
		var count: int = _num_agents * int(_entries[i]["size"])
		var bytes := inputs.get_buffer(count * int(BYTES_OF[dtype]))
		if LudusPolicyReader.is_image(_policy.reader().entries[i]):
			images.append(bytes)
		else:
			vectors.append(_numbers(bytes, dtype, count))
	var masks := inputs.get_buffer(_num_agents * _mask_size)
	_network.run(_slots, vectors, images, _states)
	for slot in _num_agents:
		_actions.choose(_network.outputs, slot * _network.num_outputs, slot, masks, null)
	_store_floats(answers, _network.outputs)
	_store_floats(answers, _log_stds())
	for choice in _actions.discrete:
		answers.store_64(choice)
	_store_floats(answers, _actions.continuous)


## The log deviations of all agents.
func _log_stds() -> Array:
	var read := _policy.reader()
	var log_stds := []
	for slot in _num_agents:
		if not read.has_own_log_std:
			log_stds.append_array(read.log_std)
			continue
		var last: int = (slot + 1) * _network.num_outputs
		for i in range(last - read.low.size(), last):
			var log_std: float = _network.outputs[i]
			log_stds.append(clamp(log_std, read.log_std_range[0], read.log_std_range[1]))
	return log_stds


static func _store_floats(file: File, numbers: Array) -> void:
	for number in numbers:
		file.store_float(number)


static func _numbers(bytes: PoolByteArray, dtype: String, count: int) -> Array:
	match dtype:
		"float32":
			return Array(LudusWire.read_floats(bytes, 0, count))
		"int64":
			return LudusWire.read_longs(bytes, 0, count)
	return Array(bytes)
