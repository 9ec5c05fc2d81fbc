extends "res://addons/ludus/agent/policy_batch.gd"
## A [LudusPolicyBatch] whose agents all belong to simulations: it asks those by index, without the
## detour over their seats.

const LudusSimulationAgent := preload("res://addons/ludus/simulation/simulation_agent.gd")
const LudusSimulationSeat := preload("res://addons/ludus/simulation/simulation_seat.gd")

var _simulations: Array[LudusSimulation] = []
var _indices: PackedInt32Array = []
var _seats: Array[LudusSimulationSeat] = []
## Whether a slot has no simulation, because its host has left the scene.
var _has_departed: bool = false


## Whether this batch can take these agents.
static func fits(members: Array[LudusAgent]) -> bool:
	for agent: LudusAgent in members:
		if agent is not LudusSimulationAgent:
			return false
	return true


func replace_agents(members: Array[LudusAgent]) -> bool:
	_simulations.resize(members.size())
	_indices.resize(members.size())
	_seats.resize(members.size())
	return super(members)


func set_agent(slot: int, agent: LudusAgent) -> void:
	super(slot, agent)
	var seat: LudusSimulationSeat = (agent as LudusSimulationAgent).seat if agent != null else null
	_seats[slot] = seat
	_has_departed = seat == null or (_has_departed and _targets.has(_departed))
	if seat == null:
		return
	seat.is_played = true
	_simulations[slot] = seat.simulation
	_indices[slot] = seat.index


func drop_leavers() -> void:
	super()
	_has_departed = _targets.has(_departed)


func play_randomly(rng: RandomNumberGenerator) -> void:
	if _has_departed:
		super(rng)
		return
	var limit := layout.max_steps if layout.max_steps > 0 else 1 << 62
	var has_truncation := layout.has_truncation
	_num_steps += 1
	for slot: int in _simulations.size():
		if _seats[slot].is_idle:
			_begun_at[slot] = _num_steps
			continue
		var simulation := _simulations[slot]
		var index := _indices[slot]
		simulation.get_reward(index)
		var is_over := simulation.is_done(index) or _num_steps - _begun_at[slot] >= limit
		if is_over or (has_truncation and simulation.is_truncated(index)):
			_begun_at[slot] = _num_steps
			simulation.world.begin_episode()
			_seats[slot].reset()
			if _seats[slot].is_idle:
				continue
		simulation.get_observation(index)
	# Only now: the end of one agent's episode may begin another one's, or make it wait.
	var num := agents.size()
	for slot: int in num:
		active[slot] = int(not _seats[slot].is_idle)
	set_actions(layout.random_choices(num, rng), layout.random_numbers(num, rng))


func _apply() -> void:
	if _has_departed:
		super()
	elif layout.is_one_choice:
		for slot: int in _list_acting():
			_simulations[slot].apply_action(_indices[slot], _discrete[slot])
	else:
		for slot: int in _list_acting():
			_simulations[slot].apply_action(_indices[slot], _actions[slot])


func _ask_outcomes() -> void:
	if _has_departed:
		super()
		return
	var has_truncation := layout.has_truncation
	for slot: int in _list_acting():
		var simulation := _simulations[slot]
		var index := _indices[slot]
		_rewards[slot] = simulation.get_reward(index)
		if simulation.is_done(index):
			_terminated[slot] = 1
		elif has_truncation and simulation.is_truncated(index):
			_truncated[slot] = 1


func _ask_numbers(numbers: PackedFloat32Array) -> void:
	if _has_departed:
		super(numbers)
		return
	var size := _flat_size
	var next := 0
	for slot: int in _list_acting():
		if slot > next:
			numbers.resize(slot * size)
		next = slot + 1
		var value: Variant = _simulations[slot].get_observation(_indices[slot])
		if value is PackedFloat32Array and (value as PackedFloat32Array).size() == size:
			numbers.append_array(value)
		else:
			numbers.append_array(_numbers_of(slot, value))


func _ask_observations() -> void:
	if _has_departed:
		super()
		return
	for slot: int in _list_acting():
		_observations[slot] = _simulations[slot].get_observation(_indices[slot])
