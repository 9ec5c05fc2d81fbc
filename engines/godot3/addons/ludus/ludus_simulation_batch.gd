class_name LudusSimulationBatch
extends LudusPolicyBatch
## A [LudusPolicyBatch] whose agents all belong to simulations: it asks those by index, without the
## detour over their seats.

var _simulations: Array = []
var _indices: Array = []
var _seats: Array = []
## Whether a slot has no simulation, because its host has left the scene.
var _has_lost: bool = false


func _init(name: String, members: Array, worlds: PoolIntArray, max_steps_override: int).(
	name, members, worlds, max_steps_override
) -> void:
	pass


## Whether this batch can take these agents.
static func fits(members: Array) -> bool:
	for agent in members:
		if not agent is LudusSimulationAgent:
			return false
	return true


func replace_agents(members: Array) -> bool:
	_simulations.resize(members.size())
	_indices.resize(members.size())
	_seats.resize(members.size())
	return .replace_agents(members)


func set_agent(slot: int, agent: LudusAgent) -> void:
	.set_agent(slot, agent)
	var seat: LudusSimulationSeat = (agent as LudusSimulationAgent).seat if agent != null else null
	_seats[slot] = seat
	_has_lost = seat == null or (_has_lost and _targets.has(_lost))
	if seat == null:
		return
	seat.is_played = true
	_simulations[slot] = seat.simulation
	_indices[slot] = seat.index


func drop_leavers() -> void:
	.drop_leavers()
	_has_lost = _targets.has(_lost)


func collect_outcomes() -> void:
	if _has_lost:
		.collect_outcomes()
		return
	clear_outcomes()
	var limit := layout.max_steps if layout.max_steps > 0 else NO_LIMIT
	var has_truncation := layout.has_truncation
	for slot in _simulations.size():
		if active[slot] == 0:
			continue
		var simulation: LudusSimulation = _simulations[slot]
		var index: int = _indices[slot]
		var steps := _steps[slot] + 1
		_steps[slot] = steps
		_rewards[slot] = simulation.get_reward(index)
		if simulation.is_done(index):
			_terminated[slot] = 1
			_end(slot)
		elif steps >= limit or (has_truncation and simulation.is_truncated(index)):
			_truncated[slot] = 1
			_end(slot)


func play_randomly(rng: RandomNumberGenerator) -> void:
	if _has_lost:
		.play_randomly(rng)
		return
	var limit := layout.max_steps if layout.max_steps > 0 else NO_LIMIT
	for slot in _simulations.size():
		if _seats[slot].is_idle:
			continue
		var simulation: LudusSimulation = _simulations[slot]
		var index: int = _indices[slot]
		_steps[slot] = _steps[slot] + 1
		var _reward := simulation.get_reward(index)
		if simulation.is_done(index) or _steps[slot] >= limit:
			_steps[slot] = 0
			simulation.world.begin_episode()
			_seats[slot].reset()
			if _seats[slot].is_idle:
				continue
		simulation.get_observation(index)
	# Only now: the end of one agent's episode may begin another one's, or make it wait.
	var num := agents.size()
	for slot in num:
		active[slot] = int(not _seats[slot].is_idle)
	set_actions(layout.random_choices(num, rng), layout.random_numbers(num, rng))


func _apply() -> void:
	if _has_lost:
		._apply()
	elif layout.num_discrete == 1 and layout.continuous_size == 0:
		for slot in _simulations.size():
			if active[slot] == 1:
				_simulations[slot].apply_action(_indices[slot], _discrete[slot])
	else:
		for slot in _simulations.size():
			if active[slot] == 1:
				var action = layout.action_of(slot, _discrete, _continuous)
				_simulations[slot].apply_action(_indices[slot], action)


func _observe_all() -> PoolRealArray:
	if _has_lost:
		return ._observe_all()
	var numbers := PoolRealArray()
	var size := _flat_size
	for slot in _simulations.size():
		if active[slot] == 0:
			numbers.append_array(_zeros)
			continue
		var value = _simulations[slot].get_observation(_indices[slot])
		if value is PoolRealArray and value.size() == size:
			numbers.append_array(value)
		else:
			numbers.append_array(_flat_numbers(slot, value))
	return numbers
