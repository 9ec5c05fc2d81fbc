extends SceneTree
## Runs an exported policy on the observations of a parity test, see engines.py.
## Argument: the folder with request.json and inputs.bin; answers.bin is written there.

const LudusPolicyActions := preload("res://addons/ludus/policy/policy_actions.gd")
const LudusPolicyNetwork := preload("res://addons/ludus/policy/policy_network.gd")

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
var _slots: PackedInt32Array = []
var _states: PackedVector4Array = []


func _initialize() -> void:
	var folder := OS.get_cmdline_user_args()[0]
	var text := FileAccess.get_file_as_string(folder.path_join(REQUEST))
	var request: Dictionary = JSON.parse_string(text)
	var problem := _load(request)
	if not problem.is_empty():
		printerr("ludus: ", problem)
		quit(1)
		return
	var inputs := FileAccess.open(folder.path_join(INPUTS), FileAccess.READ)
	var answers := FileAccess.open(folder.path_join(ANSWERS), FileAccess.WRITE)
	var num_steps: int = request["num_steps"]
	for step: int in num_steps:
		_answer(inputs, answers)
	answers.close()
	quit()


## Prepares the policy; says what is wrong with it.
func _load(request: Dictionary) -> String:
	_num_agents = request["num_agents"]
	_mask_size = request["mask_size"]
	_entries = request["entries"]
	_policy = LudusPolicy.load_file(str(request["policy"]))
	if not _policy.error.is_empty():
		return _policy.error
	_network = _policy.network()
	_actions = LudusPolicyActions.new(_policy.reader())
	_actions.reserve(_num_agents)
	_states.resize(_num_agents * _network.memory_blocks)
	for slot: int in _num_agents:
		_slots.append(slot)
	return ""


## Answers one step.
func _answer(inputs: FileAccess, answers: FileAccess) -> void:
	var observed: Array[PackedByteArray] = []
	for entry: Dictionary in _entries:
		var size: int = entry["size"]
		var bytes_each: int = BYTES_OF[entry["dtype"]]
		observed.append(inputs.get_buffer(_num_agents * size * bytes_each))
	var masks := inputs.get_buffer(_num_agents * _mask_size)
	_network.run(_slots, observed, _states)
	var outputs := _network.outputs
	for slot: int in _num_agents:
		_actions.choose(outputs, slot * _network.num_outputs, slot, masks, null)
	answers.store_buffer(outputs.to_byte_array())
	answers.store_buffer(_log_stds(outputs).to_byte_array())
	answers.store_buffer(_actions.discrete.to_byte_array())
	answers.store_buffer(_actions.continuous.to_byte_array())


## The log deviations of all agents.
func _log_stds(outputs: PackedFloat32Array) -> PackedFloat32Array:
	var read := _policy.reader()
	var log_stds := PackedFloat32Array()
	var size := read.low.size()
	for slot: int in _num_agents:
		if not read.has_own_log_std:
			log_stds.append_array(read.log_std)
			continue
		var last := (slot + 1) * _network.num_outputs
		for i: int in range(last - size, last):
			log_stds.append(clampf(outputs[i], read.log_std_range[0], read.log_std_range[1]))
	return log_stds
