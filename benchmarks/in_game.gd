extends SceneTree
## Measures how long policies take inside the game; run by in_game.py.
##
## Prints one JSON object per line: file, agents, and microseconds per agent of the network with the
## choice of actions, and of everything, with the reading of observations and the handing out of
## actions.

const LudusPolicyActions := preload("res://addons/ludus/policy/policy_actions.gd")
const LudusPolicyReader := preload("res://addons/ludus/policy/policy_reader.gd")

const ROUND_US := 2000


## An agent that does nothing but observe.
class Agent:
	extends LudusAgent

	var seen: Variant

	func apply_action(_action: Variant) -> void:
		pass

	func get_observation() -> Variant:
		return seen

	func get_reward() -> float:
		return 0.0

	func is_done() -> bool:
		return false

	func reset() -> void:
		pass


func _initialize() -> void:
	_run.call_deferred()


func _run() -> void:
	var folder := ""
	var budget_us := 1000000
	for argument: String in OS.get_cmdline_user_args():
		if argument.begins_with("--models="):
			folder = argument.trim_prefix("--models=")
		if argument.begins_with("--budget-us="):
			budget_us = argument.trim_prefix("--budget-us=").to_int()
	for file: String in DirAccess.get_files_at(folder):
		var policy := LudusPolicy.load_file(folder.path_join(file))
		var began := Time.get_ticks_usec()
		if policy.network() == null:
			push_error(policy.error)
			quit(1)
			return
		var load_us := Time.get_ticks_usec() - began
		for num_agents: int in [1, 16, 64]:
			if num_agents > 1 and not policy.network().visions.is_empty():
				continue
			var line := {"file": file, "agents": num_agents, "load_us": load_us}
			line["network_us"] = _network_us(policy, num_agents, budget_us)
			line["all_us"] = _all_us(policy, num_agents, budget_us)
			print(JSON.stringify(line))
	quit()


func _network_us(policy: LudusPolicy, num_agents: int, budget_us: int) -> float:
	var network := policy.network()
	var actions := LudusPolicyActions.new(policy.reader())
	actions.reserve(num_agents)
	var slots := PackedInt32Array(range(num_agents))
	var states := PackedVector4Array()
	states.resize(num_agents * network.memory_blocks)
	var observed: Array[PackedByteArray] = []
	for entry: LudusObservationEntry in policy.reader().entries:
		observed.append(_random_bytes(entry, num_agents))
	var once := func() -> void:
		network.run(slots, observed, states)
		for slot: int in slots:
			actions.choose(network.outputs, slot * network.num_outputs, slot, [], null)
	return _measure(once, budget_us) / num_agents


func _all_us(policy: LudusPolicy, num_agents: int, budget_us: int) -> float:
	var read := policy.reader()
	var agents: Array[Agent] = []
	for i: int in num_agents:
		var agent := Agent.new()
		agent.policy = policy
		agent.ticks_per_step = 1
		agent.action = read.components
		agent.observation = read.entries
		var entry := read.entries[0]
		var bytes := _random_bytes(entry, 1)
		agent.seen = bytes if LudusPolicyReader.is_image(entry) else bytes.to_float32_array()
		root.add_child(agent)
		agents.append(agent)
	var player := LudusPolicyPlayer.new()
	root.add_child(player)
	var spent := _measure(player.advance, budget_us) / num_agents
	player.free()
	for agent: Agent in agents:
		agent.free()
	return spent


## Microseconds of one call: the least of many short rounds, to keep out what else the machine does.
func _measure(once: Callable, budget_us: int) -> float:
	once.call()
	var began := Time.get_ticks_usec()
	once.call()
	var count := maxi(1, ROUND_US / maxi(1, Time.get_ticks_usec() - began))
	var best := INF
	var ends := Time.get_ticks_usec() + budget_us
	while Time.get_ticks_usec() < ends:
		began = Time.get_ticks_usec()
		for i: int in count:
			once.call()
		best = minf(best, float(Time.get_ticks_usec() - began) / count)
	return best


func _random_bytes(entry: LudusObservationEntry, count: int) -> PackedByteArray:
	var bytes := PackedByteArray()
	var floats := PackedFloat32Array()
	for i: int in entry.size() * count:
		if entry.dtype == LudusObservationEntry.DType.UINT8:
			bytes.append(randi() % 256)
		else:
			floats.append(randfn(0.0, 1.0))
	return floats.to_byte_array() if bytes.is_empty() else bytes
