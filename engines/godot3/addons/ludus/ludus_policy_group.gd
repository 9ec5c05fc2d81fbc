class_name LudusPolicyGroup
extends Reference
## Agents that one [LudusPolicy] plays together, in slots.
##
## What an agent lives through is told by a [LudusPolicyBatch], as in training. The episodes are up
## to [LudusPolicyPlayer].

const INFINITE := '%s: observation["%s"][%d] is %s: look for a division by zero in the game'

## What the agents have in common, and their steps.
var batch: LudusPolicyBatch
## The [LudusWorld] of the agent in each slot.
var worlds: Array = []
## Physics ticks per decision.
var ticks_per_step: int = 1
## What is wrong with an observation, when that is first seen; the agents play on.
var warning: String = ""

var _policy: LudusPolicy
var _has_warned: bool = false
var _network: LudusPolicyNetwork
var _frames: LudusPolicyFrames
var _actions: LudusPolicyActions
var _returns: Array = []
var _generators: Array = []
## Tick from which a slot that waits may act; -1 if it does not wait.
var _ready_at: Array = []
var _states: Array = []
var _active_slots: Array = []
## For each vector entry and each image of the policy: the number of the agents' entry.
var _vector_entries: Array = []
var _image_entries: Array = []
var _starts: Array = []


## Begins with the declarations of an agent, which [method LudusPolicy.incompatibility] has found
## right.
func _init(first: LudusAgent) -> void:
	_policy = first.policy
	_network = _policy.network()
	_frames = LudusPolicyFrames.new(_policy.reader().frames)
	_actions = LudusPolicyActions.new(_policy.reader())
	ticks_per_step = first.ticks_per_step
	batch = LudusPolicyBatch.new(
		first.policy_name, [first], PoolIntArray([0]), 0, _policy.reader().entries
	)
	batch.set_agent(0, null)
	_reserve(1)
	for entry in _policy.reader().entries:
		var i := _find_entry(entry.name)
		if LudusPolicyReader.is_image(entry):
			_image_entries.append(i)
		else:
			_vector_entries.append(i)


## Whether an agent can take part: it lives by the same rules.
func accepts(agent: LudusAgent) -> bool:
	var layout := batch.layout
	var is_every_tick: bool = agent.action_timing == LudusAgent.ActionTiming.EVERY_TICK
	return (
		is_instance_valid(agent.target)
		and agent.policy == _policy
		and agent.policy_name == batch.policy_name
		and agent.ticks_per_step == ticks_per_step
		and agent.max_episode_steps == layout.max_steps
		and agent.has_action_mask == layout.has_action_mask
		and agent.has_truncation() == layout.has_truncation
		and is_every_tick == layout.is_every_tick
	)


## Whether an agent takes part.
func has(agent: LudusAgent) -> bool:
	return batch.agents.has(agent)


## Puts an agent into a free slot and returns that; it does not act yet.
func join(agent: LudusAgent) -> int:
	var slot := 0
	while slot < batch.agents.size() and not _is_free(slot):
		slot += 1
	if slot == batch.agents.size():
		var _added := batch.add_slot()
		_reserve(slot + 1)
	batch.set_agent(slot, agent)
	worlds[slot] = agent.world
	return slot


## Takes an agent out that something else plays from now on.
func leave(slot: int) -> void:
	var agent: LudusAgent = batch.agents[slot]
	batch.set_agent(slot, null)
	agent.join_batch(null, -1)
	_ready_at[slot] = -1


## Begins the episode of a slot, which acts from the first decision at [param tick] or later on.
func begin(slot: int, tick: int) -> void:
	_ready_at[slot] = tick
	_returns[slot] = 0.0
	_frames.begin(slot)
	for i in _network.memory_blocks:
		_states[slot * _network.memory_blocks + i] = Vector3.ZERO
	# The world's own stream goes on as in training.
	_generators[slot].seed = hash([worlds[slot].rng.seed, slot])


## Whether the agent of a slot acts or waits to act.
func is_playing(slot: int) -> bool:
	return batch.active[slot] == 1 or _ready_at[slot] >= 0


## Takes in what the last step brought. The slots that ended stand in
## [member LudusPolicyBatch.final_slots].
func collect() -> void:
	batch.collect_outcomes()
	for slot in _active_slots:
		_returns[slot] += batch.reward(slot)


## Sum of the rewards of the episode of a slot.
func episode_return(slot: int) -> float:
	return _returns[slot]


## Lets all agents that wait no longer, and all that play, decide and act.
func act(tick: int) -> void:
	_active_slots.clear()
	for slot in batch.agents.size():
		if _ready_at[slot] >= 0 and _ready_at[slot] <= tick:
			_ready_at[slot] = -1
			# Its agent may have left with its scene: then the episode never began.
			if is_instance_valid(batch.agents[slot]):
				batch.activate(slot)
		if batch.active[slot] == 1:
			_active_slots.append(slot)
	if _active_slots.empty():
		return
	var allowed := PoolByteArray()
	if batch.layout.has_action_mask:
		allowed = batch.masks_to_bytes()
	_observe()
	for row in _active_slots.size():
		var slot: int = _active_slots[row]
		var rng: RandomNumberGenerator = (
			_generators[slot]
			if batch.agents[slot].sample_actions
			else null
		)
		_actions.choose(_network.outputs, row * _network.num_outputs, slot, allowed, rng)
	batch.set_actions(_actions.discrete, _actions.continuous)


func _observe() -> void:
	var bytes := batch.observations_to_bytes()
	var vectors := []
	for i in _vector_entries:
		vectors.append(_frames.push(i, _numbers(bytes, i), batch.layout.entries[i].size()))
	var images := []
	for i in _image_entries:
		var pixels := bytes.subarray(_starts[i], _starts[i] + _num_bytes(i) - 1)
		images.append(_frames.push(i, pixels, batch.layout.entries[i].size()))
	_frames.end_step(_active_slots)
	_network.run(_active_slots, vectors, images, _states)
	if not _network.is_input_finite and not _has_warned:
		_has_warned = true
		warning = _describe_infinite(bytes)


## Names the first number that is NaN or infinite: what such numbers decide is arbitrary.
func _describe_infinite(bytes: PoolByteArray) -> String:
	for slot in _active_slots:
		for i in _vector_entries:
			var entry: LudusObservationEntry = batch.layout.entries[i]
			var numbers := _numbers(bytes, i)
			for k in entry.size():
				var number: float = numbers[slot * entry.size() + k]
				if is_nan(number) or is_inf(number):
					return INFINITE % [batch.where(slot), entry.name, k, number]
	return ""


func _numbers(bytes: PoolByteArray, i: int) -> Array:
	var count: int = batch.layout.entries[i].size() * batch.agents.size()
	match batch.layout.entries[i].dtype:
		LudusObservationEntry.DType.UINT8:
			return Array(bytes.subarray(_starts[i], _starts[i] + count - 1))
		LudusObservationEntry.DType.INT64:
			return LudusWire.read_longs(bytes, _starts[i], count)
	return Array(LudusWire.read_floats(bytes, _starts[i], count))


func _num_bytes(i: int) -> int:
	return batch.layout.entries[i].num_bytes() * batch.agents.size()


func _find_entry(entry_name: String) -> int:
	for i in batch.layout.entries.size():
		if batch.layout.entries[i].name == entry_name:
			return i
	return -1


func _is_free(slot: int) -> bool:
	return batch.agents[slot] == null and not is_playing(slot)


func _reserve(num_slots: int) -> void:
	worlds.append(null)
	_returns.append(0.0)
	_ready_at.append(-1)
	for _i in _network.memory_blocks:
		_states.append(Vector3.ZERO)
	_frames.reserve(num_slots)
	_actions.reserve(num_slots)
	_generators.append(RandomNumberGenerator.new())
	_starts.clear()
	var start := 0
	for entry in batch.layout.entries:
		_starts.append(start)
		start += LudusWire.padded(entry.num_bytes() * num_slots)
