extends SceneTree
## The same as in_game.gd for Godot 3; run by in_game.py.

const ROUND_US := 2000

var _network: LudusPolicyNetwork
var _actions: LudusPolicyActions
var _slots: Array
var _states: Array
var _vectors: Array
var _images: Array
var _player: LudusPolicyPlayer


## An agent that does nothing but observe.
class Agent:
	extends LudusAgent

	var seen

	func apply_action(_action) -> void:
		pass

	func get_observation():
		return seen

	func get_reward() -> float:
		return 0.0

	func is_done() -> bool:
		return false

	func reset() -> void:
		pass


func _initialize() -> void:
	call_deferred("_run")


func _run() -> void:
	var budget_us := int(_argument("--budget-us="))
	for path in _paths(_argument("--models=")):
		var policy: LudusPolicy = LudusPolicy.load_file(path)
		for num_agents in [1, 16, 64]:
			if num_agents > 1 and not policy.network().visions.empty():
				continue
			var line := {"file": path.get_file(), "agents": num_agents}
			_prepare_network(policy, num_agents)
			line["network_us"] = _measure("_run_network", budget_us) / num_agents
			var agents := _add_agents(policy, num_agents)
			line["all_us"] = _measure("_advance", budget_us) / num_agents
			for node in agents + [_player]:
				node.free()
			print(JSON.print(line))
	quit()


func _argument(prefix: String) -> String:
	for argument in OS.get_cmdline_args():
		if argument.begins_with(prefix):
			return argument.trim_prefix(prefix)
	return ""


func _paths(folder: String) -> Array:
	var found := []
	var directory := Directory.new()
	if directory.open(folder) == OK and directory.list_dir_begin(true) == OK:
		var file := directory.get_next()
		while not file.empty():
			found.append(folder.plus_file(file))
			file = directory.get_next()
	found.sort()
	return found


func _prepare_network(policy: LudusPolicy, num_agents: int) -> void:
	_network = policy.network()
	_actions = LudusPolicyActions.new(policy.reader())
	_actions.reserve(num_agents)
	_slots = range(num_agents)
	_states.resize(num_agents * _network.memory_blocks)
	_states.fill(Vector3.ZERO)
	_vectors = []
	_images = []
	for entry in policy.reader().entries:
		var numbers = _random_numbers(entry, num_agents)
		if LudusPolicyReader.is_image(entry):
			_images.append(numbers)
		else:
			_vectors.append(Array(numbers))


func _run_network() -> void:
	var none := PoolByteArray()
	_network.run(_slots, _vectors, _images, _states)
	for slot in _slots:
		_actions.choose(_network.outputs, slot * _network.num_outputs, slot, none, null)


func _add_agents(policy: LudusPolicy, num_agents: int) -> Array:
	var read := policy.reader()
	var agents := []
	for _i in num_agents:
		var agent := Agent.new()
		agent.policy = policy
		agent.ticks_per_step = 1
		agent.action = read.components
		agent.observation = read.entries
		agent.seen = _random_numbers(read.entries[0], 1)
		root.add_child(agent)
		agents.append(agent)
	_player = LudusPolicyPlayer.new()
	root.add_child(_player)
	return agents


func _advance() -> void:
	_player.advance()


## Microseconds of one call: the least of many short rounds, to keep out what else the machine does.
func _measure(method: String, budget_us: int) -> float:
	call(method)
	var began := OS.get_ticks_usec()
	call(method)
	var count := int(max(1, ROUND_US / max(1, OS.get_ticks_usec() - began)))
	var best := INF
	var ends := OS.get_ticks_usec() + budget_us
	while OS.get_ticks_usec() < ends:
		began = OS.get_ticks_usec()
		for _i in count:
			call(method)
		best = min(best, float(OS.get_ticks_usec() - began) / count)
	return best


## Bytes of images, or other numbers.
func _random_numbers(entry: LudusObservationEntry, count: int):
	var rng := RandomNumberGenerator.new()
	var numbers := []
	for _i in entry.size() * count:
		var is_image := LudusPolicyReader.is_image(entry)
		numbers.append(rng.randi() % 256 if is_image else rng.randfn(0.0, 1.0))
	return PoolByteArray(numbers) if LudusPolicyReader.is_image(entry) else PoolRealArray(numbers)
