class_name LudusPolicyBatch
extends RefCounted
## All agents of one policy in slots: hands out their actions, puts their observations together.
##
## This is the hot path: packed arrays, no text, no dictionary unless the game itself uses one.

## Name of the policy.
var policy_name: String
## The agent in each slot; null in a free slot.
var agents: Array[LudusAgent] = []
## Which slots act on the observation that is sent next.
var active: PackedByteArray = []
## Slots whose episode ended in the last step.
var final_slots: PackedInt32Array = []
## What is wrong with the game, or an empty text. Set once; the run fails with it.
var error: String = ""

var _entries: Array[LudusObservationEntry] = []
var _components: Array[LudusActionComponent] = []
var _has_action_mask: bool = false
var _has_truncation: bool = false
var _is_every_tick: bool = true
var _mask_size: int = 0
var _num_discrete: int = 0
var _continuous_size: int = 0
var _max_steps: int = 0
var _is_flat: bool = false
var _flat_size: int = 0
var _zeros: PackedFloat32Array = []
var _slot_worlds: PackedInt32Array = []
var _rewards: PackedFloat32Array = []
var _terminated: PackedByteArray = []
var _truncated: PackedByteArray = []
var _final_parts: Array[PackedByteArray] = []


## Takes over the declarations of the first agent and checks that the others agree.
func _init(
	name: String, members: Array[LudusAgent], worlds: PackedInt32Array, max_steps_override: int
) -> void:
	policy_name = name
	agents = members
	_slot_worlds = worlds
	var first := agents[agents.find_custom(func(agent: LudusAgent) -> bool: return agent != null)]
	_components = first.action
	_has_action_mask = first.has_action_mask
	_has_truncation = first.target.has_method(&"is_truncated")
	_is_every_tick = first.action_timing == LudusAgent.ActionTiming.EVERY_TICK
	_max_steps = max_steps_override if max_steps_override > 0 else first.max_episode_steps
	_measure_action()
	_entries = first.observation if not first.observation.is_empty() else _infer_entries(first)
	_is_flat = _entries.size() == 1 and _entries[0].dtype == LudusObservationEntry.DType.FLOAT32
	if not _entries.is_empty():
		_flat_size = _entries[0].size()
		_zeros.resize(_flat_size)
	_allocate()


## Describes the policy for the handshake (PROTOCOL.md §4).
func to_json(agents_per_world: int) -> Dictionary:
	var first := agents[0]
	var slots: Array[Dictionary] = []
	for slot: int in agents.size():
		var agent := agents[slot]
		(
			slots
			. append(
				{
					"world": _slot_worlds[slot],
					"path": agent.path_in_world() if agent != null else null,
				}
			)
		)
	var is_shared := first.world.episode_mode == LudusWorld.Episode.WORLD
	return {
		"name": policy_name,
		"num_agents": agents.size(),
		"agents_per_world": agents_per_world,
		"episode": "world" if is_shared else "agent",
		"max_episode_steps": _max_steps if _max_steps > 0 else null,
		"observation":
		_entries.map(func(entry: LudusObservationEntry) -> Dictionary: return entry.to_json()),
		"action":
		_components.map(func(part: LudusActionComponent) -> Dictionary: return part.to_json()),
		"has_action_mask": _has_action_mask,
		"agents": slots,
		"settings": first.settings.to_json() if first.settings != null else {},
	}


## Fills the slots anew after the worlds were rebuilt. Returns false if the agents changed.
func replace_agents(members: Array[LudusAgent]) -> bool:
	if members.size() != agents.size():
		return false
	agents = members
	_allocate()
	return true


## Number of bytes of this policy's part of a [code]STEP[/code].
func action_bytes() -> int:
	var num := agents.size()
	return LudusWire.padded(num * _num_discrete * 8) + LudusWire.padded(num * _continuous_size * 4)


## Reads the actions from a [code]STEP[/code] at [param offset] and hands them to the game.
func apply_actions(payload: PackedByteArray, offset: int) -> void:
	var num := agents.size()
	var middle := offset + LudusWire.padded(num * _num_discrete * 8)
	var discrete := payload.slice(offset, offset + num * _num_discrete * 8).to_int64_array()
	var continuous := payload.slice(middle, middle + num * _continuous_size * 4).to_float32_array()
	for slot: int in num:
		if active[slot] == 0:
			continue
		var agent := agents[slot]
		if not is_instance_valid(agent):
			continue
		agent.current_action = _action_of(slot, discrete, continuous)
		agent.target.apply_action(agent.current_action)


## Hands the game the same actions again, in the later ticks of a step.
func repeat_actions() -> void:
	if not _is_every_tick:
		return
	for slot: int in agents.size():
		if active[slot] == 1 and is_instance_valid(agents[slot]):
			agents[slot].target.apply_action(agents[slot].current_action)


## Collects what the last step brought: rewards, ends of episodes and final observations. Agents
## whose episode has ended are left inactive; [LudusGame] begins the next one.
func collect_outcomes() -> void:
	clear_outcomes()
	for slot: int in agents.size():
		if active[slot] == 0:
			continue
		var agent := agents[slot]
		if not is_instance_valid(agent) or not agent.is_inside_tree():
			_end_lost(slot)
			continue
		var target := agent.target
		agent.episode_steps += 1
		_rewards[slot] = target.get_reward()
		if target.is_done():
			_terminated[slot] = 1
			_end(slot, agent)
		elif _max_steps > 0 and agent.episode_steps >= _max_steps:
			_truncated[slot] = 1
			_end(slot, agent)
		elif _has_truncation and target.is_truncated():
			_truncated[slot] = 1
			_end(slot, agent)


## Forgets the outcomes of the last step.
func clear_outcomes() -> void:
	var num := agents.size()
	_rewards.resize(num)
	_rewards.fill(0.0)
	_terminated.resize(num)
	_terminated.fill(0)
	_truncated.resize(num)
	_truncated.fill(0)
	final_slots.clear()
	_final_parts.clear()
	for i: int in _entries.size():
		_final_parts.append(PackedByteArray())


## Appends this policy's part of a [code]BATCH[/code] (PROTOCOL.md §7), without final observations.
func append_to(frame: PackedByteArray) -> void:
	if _is_flat:
		_append_flat(frame)
	else:
		_append_entries(frame)
	frame.append_array(_rewards.to_byte_array())
	LudusWire.pad(frame)
	for flags: PackedByteArray in [_terminated, _truncated, active]:
		frame.append_array(flags)
		LudusWire.pad(frame)
	if _has_action_mask:
		_append_masks(frame)


## Appends this policy's final observations (PROTOCOL.md §7).
func append_final_to(frame: PackedByteArray) -> void:
	var head := frame.size()
	frame.resize(head + 8)
	frame.encode_u32(head, final_slots.size())
	frame.append_array(final_slots.to_byte_array())
	LudusWire.pad(frame)
	for part: PackedByteArray in _final_parts:
		frame.append_array(part)
		LudusWire.pad(frame)


## Plays one step with random actions, as the ceiling that [code]run_ceiling[/code] measures: all
## that the game itself does, nothing of the bridge.
func play_randomly(rng: RandomNumberGenerator) -> void:
	for slot: int in agents.size():
		var agent := agents[slot]
		if not is_instance_valid(agent):
			continue
		var target := agent.target
		agent.episode_steps += 1
		target.get_reward()
		var is_over: bool = target.is_done()
		if is_over or (_max_steps > 0 and agent.episode_steps >= _max_steps):
			agent.world.begin_episode()
			agent.begin_episode()
		target.get_observation()
		agent.current_action = random_action(rng)
		target.apply_action(agent.current_action)


## Draws an action the policy could take.
func random_action(rng: RandomNumberGenerator) -> Variant:
	if _num_discrete == 1 and _continuous_size == 0:
		return rng.randi() % _components[0].n
	var by_name := {}
	var choices := PackedInt64Array()
	var numbers := PackedFloat32Array()
	for part: LudusActionComponent in _components:
		if part.kind == LudusActionComponent.Kind.DISCRETE:
			choices.append(rng.randi() % part.n)
			by_name[part.name] = choices[-1]
			continue
		var own := PackedFloat32Array()
		for i: int in part.size:
			own.append(rng.randf_range(part.low, part.high))
		numbers.append_array(own)
		by_name[part.name] = own
	if _num_discrete == 0:
		return numbers
	return choices if _continuous_size == 0 else by_name


func _measure_action() -> void:
	for part: LudusActionComponent in _components:
		if part.kind == LudusActionComponent.Kind.DISCRETE:
			_num_discrete += 1
			_mask_size += part.n
		else:
			_continuous_size += part.size


func _infer_entries(first: LudusAgent) -> Array[LudusObservationEntry]:
	first.begin_episode()
	var value: Variant = first.target.get_observation()
	var entries: Array[LudusObservationEntry] = []
	if value is not Dictionary:
		value = {"observation": value}
	for key: Variant in value:
		var entry := LudusObservationEntry.infer(str(key), value[key])
		if entry == null or entry.size() == 0:
			error = (
				'%s: get_observation() returned no numbers for entry "%s" (got %s)'
				% [_where(0), key, type_string(typeof(value[key]))]
			)
			return []
		entries.append(entry)
	return entries


func _allocate() -> void:
	var num := agents.size()
	active.resize(num)
	active.fill(0)
	clear_outcomes()


func _action_of(slot: int, discrete: PackedInt64Array, continuous: PackedFloat32Array) -> Variant:
	if _continuous_size == 0:
		if _num_discrete == 1:
			return discrete[slot]
		return discrete.slice(slot * _num_discrete, (slot + 1) * _num_discrete)
	if _num_discrete == 0:
		return continuous.slice(slot * _continuous_size, (slot + 1) * _continuous_size)
	var by_name := {}
	var next_choice := slot * _num_discrete
	var next_number := slot * _continuous_size
	for part: LudusActionComponent in _components:
		if part.kind == LudusActionComponent.Kind.DISCRETE:
			by_name[part.name] = discrete[next_choice]
			next_choice += 1
		else:
			by_name[part.name] = continuous.slice(next_number, next_number + part.size)
			next_number += part.size
	return by_name


func _end(slot: int, agent: LudusAgent) -> void:
	active[slot] = 0
	final_slots.append(slot)
	var value: Variant = agent.target.get_observation()
	for i: int in _entries.size():
		_final_parts[i].append_array(_entry_bytes(slot, _entries[i], value))


func _end_lost(slot: int) -> void:
	active[slot] = 0
	agents[slot] = null
	_terminated[slot] = 1
	final_slots.append(slot)
	for i: int in _entries.size():
		var zeros := PackedByteArray()
		zeros.resize(_entries[i].num_bytes())
		_final_parts[i].append_array(zeros)


func _append_flat(frame: PackedByteArray) -> void:
	var numbers := PackedFloat32Array()
	for slot: int in agents.size():
		if active[slot] == 0:
			numbers.append_array(_zeros)
			continue
		var value: Variant = agents[slot].target.get_observation()
		if value is PackedFloat32Array and len(value) == _flat_size:
			numbers.append_array(value)
		else:
			var bytes := _entry_bytes(slot, _entries[0], value)
			numbers.append_array(bytes.to_float32_array())
	frame.append_array(numbers.to_byte_array())
	LudusWire.pad(frame)


func _append_entries(frame: PackedByteArray) -> void:
	var values: Array[Variant] = []
	for slot: int in agents.size():
		values.append(agents[slot].target.get_observation() if active[slot] == 1 else null)
	for entry: LudusObservationEntry in _entries:
		var zeros := PackedByteArray()
		zeros.resize(entry.num_bytes())
		for slot: int in agents.size():
			var is_active := active[slot] == 1
			frame.append_array(_entry_bytes(slot, entry, values[slot]) if is_active else zeros)
		LudusWire.pad(frame)


func _append_masks(frame: PackedByteArray) -> void:
	var free := PackedByteArray()
	free.resize(_mask_size)
	free.fill(1)
	for slot: int in agents.size():
		var mask: PackedByteArray = free
		if active[slot] == 1:
			mask = agents[slot].target.get_action_mask()
			if mask.size() != _mask_size:
				_fail(slot, "get_action_mask()", _mask_size, mask.size())
				mask = free
		frame.append_array(mask)
	LudusWire.pad(frame)


## Bytes of one entry of what the game returned; zeros after noting the error if it does not fit.
func _entry_bytes(slot: int, entry: LudusObservationEntry, value: Variant) -> PackedByteArray:
	var part: Variant = value
	if value is Dictionary:
		part = (value as Dictionary).get(entry.name)
	elif _entries.size() > 1:
		part = null
	var bytes := entry.to_bytes(part)
	if bytes.is_empty():
		_fail(slot, 'observation["%s"]' % entry.name, entry.size(), part)
		bytes.resize(entry.num_bytes())
	return bytes


func _fail(slot: int, what: String, expected: int, got: Variant) -> void:
	if not error.is_empty():
		return
	var found := type_string(typeof(got))
	if typeof(got) >= TYPE_ARRAY:
		found += " of %d" % len(got)
	elif typeof(got) == TYPE_INT:
		found = "%d" % got
	error = "%s: %s: expected %d numbers, got %s" % [_where(slot), what, expected, found]


func _where(slot: int) -> String:
	var agent := agents[slot]
	if agent == null:
		return "policy %s, slot %d" % [policy_name, slot]
	return (
		"world %d, agent %s, step %d"
		% [agent.world.index, agent.path_in_world(), agent.episode_steps]
	)
