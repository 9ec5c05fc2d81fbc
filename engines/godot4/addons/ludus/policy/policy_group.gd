extends RefCounted
## Agents that one [LudusPolicy] plays together, in slots.
##
## What an agent lives through is told by a [LudusPolicyBatch], as in training. The episodes are up
## to [LudusPolicyPlayer].

const LudusPolicyActions := preload("res://addons/ludus/policy/policy_actions.gd")
const LudusPolicyBatch := preload("res://addons/ludus/agent/policy_batch.gd")
const LudusPolicyFrames := preload("res://addons/ludus/policy/policy_frames.gd")
const LudusPolicyNetwork := preload("res://addons/ludus/policy/policy_network.gd")
const LudusPolicyReader := preload("res://addons/ludus/policy/policy_reader.gd")
const LudusWire := preload("res://addons/ludus/bridge/wire.gd")

const INFINITE := '%s: observation["%s"][%d] is %s: look for a division by zero in the game'

## What the agents have in common, and their steps.
var batch: LudusPolicyBatch
## The world of the agent in each slot.
var worlds: Array[LudusWorld] = []
## Physics ticks per decision.
var ticks_per_step: int = 1
## What is wrong with an observation, when that is first seen; the agents play on.
var warning: String = ""

var _policy: LudusPolicy
var _has_warned: bool = false
var _network: LudusPolicyNetwork
var _frames: LudusPolicyFrames
var _actions: LudusPolicyActions
var _returns: PackedFloat64Array = []
var _generators: Array[RandomNumberGenerator] = []
## Tick from which a slot that waits may act; -1 if it does not wait.
var _ready_at: PackedInt64Array = []
var _states: PackedVector4Array = []
var _active_slots: PackedInt32Array = []
## For each entry of the policy: the number of the agents' entry.
var _entries: PackedInt32Array = []
var _starts: PackedInt32Array = []
## What all slots observed last, and what they were allowed to do.
var _observed := PackedByteArray()
var _masks := PackedByteArray()


## Begins with the declarations of an agent, which [method LudusPolicy.incompatibility] has found
## right.
func _init(first: LudusAgent) -> void:
	_policy = first.policy
	_network = _policy.network()
	_frames = LudusPolicyFrames.new(_policy.reader())
	_actions = LudusPolicyActions.new(_policy.reader())
	ticks_per_step = first.ticks_per_step
	batch = LudusPolicyBatch.new(
		first.policy_name, [first], PackedInt32Array([0]), 0, _policy.reader().entries
	)
	batch.set_agent(0, null)
	_reserve(1)
	for entry: LudusObservationEntry in _policy.reader().entries:
		_entries.append(_find_entry(entry.name))


## Whether an agent can take part: it lives by the same rules.
func accepts(agent: LudusAgent) -> bool:
	var layout := batch.layout
	var is_every_tick := agent.action_timing == LudusAgent.ActionTiming.EVERY_TICK
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
		batch.add_slot()
		_reserve(slot + 1)
	batch.set_agent(slot, agent)
	worlds[slot] = agent.world
	return slot


## Takes an agent out that something else plays from now on.
func leave(slot: int) -> void:
	var agent := batch.agents[slot]
	batch.set_agent(slot, null)
	agent.join_batch(null, -1)
	_ready_at[slot] = -1


## Begins the episode of a slot, which acts from the first decision at [param tick] or later on.
func begin(slot: int, tick: int) -> void:
	_ready_at[slot] = tick
	_returns[slot] = 0.0
	_frames.begin(slot)
	for i: int in _network.memory_blocks:
		_states[slot * _network.memory_blocks + i] = Vector4.ZERO
	# The world's own stream goes on as in training.
	_generators[slot].seed = hash([worlds[slot].rng.seed, slot])


## Whether the agent of a slot acts or waits to act.
func is_playing(slot: int) -> bool:
	return batch.active[slot] == 1 or _ready_at[slot] >= 0


## Takes in what the last step brought. The slots that ended stand in
## [member LudusPolicyBatch.final_slots].
func collect() -> void:
	batch.collect_outcomes()
	for slot: int in _active_slots:
		_returns[slot] += batch.reward(slot)


## Sum of the rewards of the episode of a slot.
func episode_return(slot: int) -> float:
	return _returns[slot]


## Lets all agents that wait no longer, and all that play, decide and act.
func act(tick: int) -> void:
	_active_slots.clear()
	for slot: int in batch.agents.size():
		if _ready_at[slot] >= 0 and _ready_at[slot] <= tick:
			_end_wait(slot)
		if batch.active[slot] == 1:
			_active_slots.append(slot)
	if _active_slots.is_empty():
		return
	_masks.clear()
	if batch.layout.has_action_mask:
		batch.append_masks(_masks)
	_observe()
	for row: int in _active_slots.size():
		var slot := _active_slots[row]
		var rng := _generators[slot] if batch.agents[slot].sample_actions else null
		_actions.choose(_network.outputs, row * _network.num_outputs, slot, _masks, rng)
	batch.set_actions(_actions.discrete, _actions.continuous)


## What a slot observed last, of one entry of the layout.
func entry_bytes(i: int, slot: int) -> PackedByteArray:
	var size := batch.layout.entries[i].num_bytes()
	return _observed.slice(_starts[i] + slot * size, _starts[i] + (slot + 1) * size)


## What a slot has just decided, and how probable that was: see [LudusWatchedAgent]. Call it right
## after [method act], as other groups may use the same network.
func describe_decision(slot: int) -> Dictionary:
	var from := _active_slots.find(slot) * _network.num_outputs
	return _actions.describe(_network.outputs, from, slot, _masks)


func _observe() -> void:
	_observed.clear()
	batch.append_observations(_observed)
	var observed: Array[PackedByteArray] = []
	for i: int in _entries:
		var num_bytes := batch.layout.entries[i].num_bytes() * batch.agents.size()
		observed.append(_observed.slice(_starts[i], _starts[i] + num_bytes))
	_network.run(_active_slots, _frames.push(observed, _active_slots), _states)
	if not _network.is_input_finite and not _has_warned:
		_has_warned = true
		warning = _describe_infinite()


## Names the first number that is NaN or infinite: what such numbers decide is arbitrary.
func _describe_infinite() -> String:
	for slot: int in _active_slots:
		for i: int in batch.layout.entries.size():
			var entry := batch.layout.entries[i]
			if entry.dtype != LudusObservationEntry.DType.FLOAT32:
				continue
			var numbers := entry_bytes(i, slot).to_float32_array()
			for k: int in numbers.size():
				if not is_finite(numbers[k]):
					return INFINITE % [batch.where(slot), entry.name, k, numbers[k]]
	return ""


func _find_entry(entry_name: String) -> int:
	for i: int in batch.layout.entries.size():
		if batch.layout.entries[i].name == entry_name:
			return i
	return -1


## Lets a slot act from now on, once its world is ready. The agent may have left with its scene
## before that: then its episode never began.
func _end_wait(slot: int) -> void:
	var has_left := not is_instance_valid(batch.agents[slot])
	if has_left or not is_instance_valid(worlds[slot]) or worlds[slot].is_ready:
		_ready_at[slot] = -1
		if not has_left:
			batch.activate(slot)


func _is_free(slot: int) -> bool:
	return batch.agents[slot] == null and not is_playing(slot)


func _reserve(num_slots: int) -> void:
	worlds.resize(num_slots)
	_returns.resize(num_slots)
	_ready_at.resize(num_slots)
	_ready_at[-1] = -1
	_states.resize(num_slots * _network.memory_blocks)
	_frames.reserve(num_slots)
	_actions.reserve(num_slots)
	_generators.append(RandomNumberGenerator.new())
	_starts.clear()
	var start := 0
	for entry: LudusObservationEntry in batch.layout.entries:
		_starts.append(start)
		start += LudusWire.padded(entry.num_bytes() * num_slots)
