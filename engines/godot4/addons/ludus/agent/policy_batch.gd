# gdlint: disable=max-public-methods
extends RefCounted
## All agents of one policy in slots: hands out their actions, puts their observations together.
##
## This is the hot path: packed arrays, no text, no dictionary unless the game itself uses one.

const LudusDepartedAgent := preload("res://addons/ludus/agent/departed_agent.gd")
const LudusPolicyLayout := preload("res://addons/ludus/agent/policy_layout.gd")
const LudusScriptReview := preload("res://addons/ludus/agent/script_review.gd")
const LudusWire := preload("res://addons/ludus/bridge/wire.gd")

## Name of the policy.
var policy_name: String
## What all agents have in common.
var layout: LudusPolicyLayout
## The agent in each slot; null in a free slot.
var agents: Array[LudusAgent] = []
## Which slots act on the observation that is sent next.
var active: PackedByteArray = []
## Slots whose episode ended in the last step.
var final_slots: PackedInt32Array = []
## What is wrong with the game, or an empty text. Set once; the run fails with it.
var error: String = ""

## The nodes that have the five methods, beside [member agents].
var _targets: Array[Object] = []
## Whether the scripts of all targets declare what their rewards and ends are, so that no step need
## look at it.
var _are_declared: bool = true
var _declaring_script: Script
## What is asked for observations, beside [member agents].
var _observers: Array[Object] = []
## Numbers in an observation that is one float32 entry; -1 if it is more than that.
var _flat_size: int = -1
var _departed: LudusDepartedAgent
var _slot_worlds: PackedInt32Array = []
var _discrete: PackedInt64Array = []
## What each slot that acts is handed in every tick of the step, unless that is one choice.
var _actions: Array[Variant] = []
## What each slot that acts observes, until it is in a frame.
var _observations: Array = []
## What an inactive slot may do: everything.
var _free_mask: PackedByteArray = []
var _continuous: PackedFloat32Array = []
## The slots that act, and [member active] as it was when they were listed.
var _acting: PackedInt32Array = []
var _listed_active: PackedByteArray = []
## Steps of this batch, of which each slot that acts knows the one in which its episode began. So
## no line of GDScript runs per agent to count, or to find those whose steps are used up.
var _num_steps: int = 0
var _begun_at: PackedInt64Array = []
## Length of the episode of each slot that no longer acts.
var _steps: PackedInt32Array = []
var _rewards: PackedFloat32Array = []
var _terminated: PackedByteArray = []
var _truncated: PackedByteArray = []
var _final_parts: Array[PackedByteArray] = []


## Takes the agents of all worlds in slot order, null for a spare slot, and the world of each slot;
## the rest is for [LudusPolicyLayout].
func _init(
	name: String,
	members: Array[LudusAgent],
	worlds: PackedInt32Array,
	max_steps_override: int,
	known_entries: Array[LudusObservationEntry] = []
) -> void:
	policy_name = name
	_slot_worlds = worlds
	layout = LudusPolicyLayout.new(members[0], max_steps_override, known_entries)
	error = layout.error
	_departed = LudusDepartedAgent.new(layout.entries)
	_free_mask.resize(layout.mask_size)
	_free_mask.fill(1)
	if layout.is_flat():
		_flat_size = layout.entries[0].size()
	replace_agents(members)


## Describes the policy for the handshake (PROTOCOL.md §4).
func to_json(agents_per_world: int) -> Dictionary:
	var slots: Array[Dictionary] = []
	for slot: int in agents.size():
		var path: Variant = agents[slot].path_in_world() if agents[slot] != null else null
		slots.append({"world": _slot_worlds[slot], "path": path})
	var description := layout.to_json()
	description["name"] = policy_name
	description["num_agents"] = agents.size()
	description["agents_per_world"] = agents_per_world
	description["agents"] = slots
	return description


## Fills all slots anew, as at the beginning. Returns false if the number of agents has changed.
func replace_agents(members: Array[LudusAgent]) -> bool:
	if not agents.is_empty() and members.size() != agents.size():
		return false
	var num := members.size()
	agents.resize(num)
	_targets.resize(num)
	_observers.resize(num)
	_observations.resize(num)
	_begun_at.resize(num)
	_steps.resize(num)
	active.resize(num)
	for slot: int in num:
		set_agent(slot, members[slot])
	clear_outcomes()
	return true


## Puts an agent into a slot, not yet active; null frees the slot.
func set_agent(slot: int, agent: LudusAgent) -> void:
	agents[slot] = agent
	active[slot] = 0
	_steps[slot] = 0
	_targets[slot] = _departed
	_observers[slot] = _departed
	if agent != null:
		_targets[slot] = agent.target
		_observers[slot] = agent.observer
		_look_at_types(agent.target.get_script())
		agent.join_batch(self, slot)


## Makes the agent of a slot act from the next observation on.
func activate(slot: int) -> void:
	active[slot] = 1
	_begun_at[slot] = _num_steps


## Steps since the episode of a slot began.
func episode_steps(slot: int) -> int:
	return _num_steps - _begun_at[slot] if active[slot] == 1 else _steps[slot]


## Replaces agents that have left the scene by stand-ins, which end in this step.
func drop_leavers() -> void:
	for slot: int in agents.size():
		var agent: Variant = agents[slot]
		if not is_instance_valid(agent) or not (agent as LudusAgent).is_inside_tree():
			agents[slot] = null
			_targets[slot] = _departed
			_observers[slot] = _departed


## Number of bytes of this policy's part of a [code]STEP[/code].
func action_bytes() -> int:
	return layout.action_bytes(agents.size())


## Adds a free slot and returns it.
func add_slot() -> int:
	var slot := agents.size()
	agents.append(null)
	_targets.append(_departed)
	_observers.append(_departed)
	_observations.append(null)
	_begun_at.append(0)
	_steps.append(0)
	active.append(0)
	_slot_worlds.append(0)
	return slot


## Reward of a slot in the last step.
func reward(slot: int) -> float:
	return _rewards[slot]


## Reads the actions from a [code]STEP[/code] at [param offset]. Returns the offset of what follows.
func read_actions(payload: PackedByteArray, offset: int) -> int:
	var num := agents.size()
	var middle := offset + layout.discrete_bytes(num)
	_discrete = payload.slice(offset, offset + num * layout.num_discrete * 8).to_int64_array()
	_continuous = (
		payload.slice(middle, middle + num * layout.continuous_size * 4).to_float32_array()
	)
	return middle + LudusWire.padded(num * layout.continuous_size * 4)


## Says which choice of an agent that acts is none, or returns an empty text.
func find_wrong_choice() -> String:
	if layout.are_all_choices(_discrete):
		return ""
	for slot: int in active.size():
		var problem := layout.find_wrong_choice(slot, _discrete) if active[slot] == 1 else ""
		if not problem.is_empty():
			return "STEP, policy %s, slot %d, %s" % [policy_name, slot, problem]
	return ""


## Hands the actions that were read to the game.
func hand_out_actions() -> void:
	if not layout.is_one_choice:
		_actions.resize(active.size())
		layout.unpack_actions(_list_acting(), _discrete, _continuous, _actions)
	_apply()


## Hands actions of all slots to the game.
func set_actions(discrete: PackedInt64Array, continuous: PackedFloat32Array) -> void:
	_discrete = discrete
	_continuous = continuous
	hand_out_actions()


## Hands the game the same actions again, in the later ticks of a step.
func repeat_actions() -> void:
	if layout.is_every_tick:
		_apply()


## Collects what the last step brought: rewards, ends of episodes and final observations. Agents
## whose episode has ended are left inactive; [LudusGame] begins the next one.
func collect_outcomes() -> void:
	clear_outcomes()
	_num_steps += 1
	_ask_outcomes()
	if layout.max_steps > 0:
		_cut_off_episodes()
	var slot := _next_ended(0)
	while slot >= 0:
		_end(slot)
		slot = _next_ended(slot + 1)


## Forgets the outcomes of the last step.
func clear_outcomes() -> void:
	var num := agents.size()
	_rewards.resize(num)
	_rewards.fill(0.0)
	_terminated.resize(num)
	_terminated.fill(0)
	_truncated.resize(num)
	_truncated.fill(0)
	if final_slots.is_empty() and not _final_parts.is_empty():
		return
	final_slots.clear()
	_final_parts.clear()
	for i: int in layout.entries.size():
		_final_parts.append(PackedByteArray())


## Appends this policy's part of a [code]BATCH[/code] (PROTOCOL.md §7), without final observations.
func append_to(frame: PackedByteArray) -> void:
	append_observations(frame)
	frame.append_array(_rewards.to_byte_array())
	LudusWire.pad(frame)
	for flags: PackedByteArray in [_terminated, _truncated, active]:
		frame.append_array(flags)
		LudusWire.pad(frame)
	if layout.has_action_mask:
		append_masks(frame)


## Appends the entries of what all slots observe, one after the other, each padded.
func append_observations(frame: PackedByteArray) -> void:
	if _flat_size >= 0:
		var numbers := PackedFloat32Array()
		_ask_numbers(numbers)
		numbers.resize(agents.size() * _flat_size)
		frame.append_array(numbers.to_byte_array())
		LudusWire.pad(frame)
		return
	_observations.fill(null)
	_ask_observations()
	_append_entries(frame)


## Appends the action masks of all slots; inactive slots may do everything.
func append_masks(frame: PackedByteArray) -> void:
	for slot: int in _targets.size():
		var mask: Variant = _targets[slot].get_action_mask() if active[slot] == 1 else _free_mask
		if mask is not PackedByteArray or len(mask) != layout.mask_size:
			_fail(slot, "get_action_mask()", "%d bytes" % layout.mask_size, mask)
			mask = _free_mask
		frame.append_array(mask)
	LudusWire.pad(frame)


## Appends this policy's final observations (PROTOCOL.md §7).
func append_final_to(frame: PackedByteArray) -> void:
	var head := frame.size()
	frame.resize(head + 8)
	frame.encode_u32(head, final_slots.size())
	if final_slots.is_empty():
		return
	frame.append_array(final_slots.to_byte_array())
	LudusWire.pad(frame)
	for part: PackedByteArray in _final_parts:
		frame.append_array(part)
		LudusWire.pad(frame)


## Plays one step with random actions, as the ceiling that [code]run_ceiling[/code] measures: all
## that the game itself does, nothing of the bridge.
func play_randomly(rng: RandomNumberGenerator) -> void:
	var limit := layout.max_steps if layout.max_steps > 0 else 1 << 62
	var has_truncation := layout.has_truncation
	_num_steps += 1
	for slot: int in _targets.size():
		var target := _targets[slot]
		active[slot] = int(target != _departed)
		if target == _departed:
			continue
		target.get_reward()
		var is_over: bool = target.is_done() or _num_steps - _begun_at[slot] >= limit
		if is_over or (has_truncation and _is_cut(slot)):
			_begun_at[slot] = _num_steps
			agents[slot].world.begin_episode()
			target.reset()
		_observers[slot].get_observation()
	var num := agents.size()
	set_actions(layout.random_choices(num, rng), layout.random_numbers(num, rng))


## Names world, agent, script and step of a slot.
func where(slot: int) -> String:
	var agent := agents[slot]
	if agent == null:
		return "policy %s, slot %d" % [policy_name, slot]
	var script := LudusScriptReview.place_of(_targets[slot])
	return (
		"world %d, agent %s%s, step %d"
		% [_slot_worlds[slot], agent.path_in_world(), script, episode_steps(slot)]
	)


## Hands each slot that acts its action.
func _apply() -> void:
	if layout.is_one_choice:
		for slot: int in _list_acting():
			_targets[slot].apply_action(_discrete[slot])
		return
	for slot: int in _list_acting():
		_targets[slot].apply_action(_actions[slot])


## Asks each slot that acts for its reward, and whether its episode has ended or is cut off.
func _ask_outcomes() -> void:
	var are_declared := _are_declared
	var has_truncation := layout.has_truncation
	for slot: int in _list_acting():
		var target := _targets[slot]
		var reward_value: Variant = target.get_reward()
		var is_done: Variant = target.is_done()
		if not are_declared:
			if reward_value is not float:
				reward_value = _to_number(slot, reward_value)
			if is_done is not bool:
				is_done = _to_flag(slot, "is_done()", is_done)
		_rewards[slot] = reward_value
		if is_done:
			_terminated[slot] = 1
		elif has_truncation and _is_cut(slot):
			_truncated[slot] = 1


## Asks each slot that acts for its observation, and appends it where that is one float32 entry, at
## its place.
func _ask_numbers(numbers: PackedFloat32Array) -> void:
	var size := _flat_size
	var next := 0
	for slot: int in _list_acting():
		if slot > next:
			numbers.resize(slot * size)
		next = slot + 1
		var value: Variant = _observers[slot].get_observation()
		if value is PackedFloat32Array and (value as PackedFloat32Array).size() == size:
			numbers.append_array(value)
		else:
			numbers.append_array(_numbers_of(slot, value))


## Asks each slot that acts what it observes.
func _ask_observations() -> void:
	for slot: int in _list_acting():
		_observations[slot] = _observers[slot].get_observation()


## The slots that act, in order; listed again only if others act than did before.
func _list_acting() -> PackedInt32Array:
	if active != _listed_active:
		_listed_active = active.duplicate()
		_acting.clear()
		for slot: int in active.size():
			if active[slot] == 1:
				_acting.append(slot)
	return _acting


func _cut_off_episodes() -> void:
	var begun_at := _num_steps - layout.max_steps
	var slot := _begun_at.find(begun_at)
	while slot >= 0:
		if active[slot] == 1 and _terminated[slot] == 0:
			_truncated[slot] = 1
		slot = _begun_at.find(begun_at, slot + 1)


## The first slot from one on whose episode has ended in this step, or -1.
func _next_ended(from: int) -> int:
	var terminated := _terminated.find(1, from)
	var truncated := _truncated.find(1, from)
	if terminated < 0 or truncated < 0:
		return maxi(terminated, truncated)
	return mini(terminated, truncated)


func _end(slot: int) -> void:
	_steps[slot] = _num_steps - _begun_at[slot]
	active[slot] = 0
	final_slots.append(slot)
	var value: Variant = _observers[slot].get_observation()
	if value is PackedFloat32Array and (value as PackedFloat32Array).size() == _flat_size:
		_final_parts[0].append_array((value as PackedFloat32Array).to_byte_array())
		return
	for i: int in layout.entries.size():
		_final_parts[i].append_array(_entry_bytes(slot, layout.entries[i], value))


## What a slot observes, as the numbers of the one entry that there is.
func _numbers_of(slot: int, value: Variant) -> PackedFloat32Array:
	return _entry_bytes(slot, layout.entries[0], value).to_float32_array()


func _append_entries(frame: PackedByteArray) -> void:
	for entry: LudusObservationEntry in layout.entries:
		var num_bytes := entry.num_bytes()
		if entry.dtype == LudusObservationEntry.DType.FLOAT32:
			_append_floats(frame, entry)
			continue
		for slot: int in _observations.size():
			if active[slot] == 1:
				frame.append_array(_entry_bytes(slot, entry, _observations[slot]))
			else:
				frame.resize(frame.size() + num_bytes)
		LudusWire.pad(frame)


## As [method _append_entries] for an entry of floats, which are put together before they are bytes.
func _append_floats(frame: PackedByteArray, entry: LudusObservationEntry) -> void:
	var numbers := PackedFloat32Array()
	var size := entry.size()
	for slot: int in _observations.size():
		var value: Variant = _observations[slot]
		if active[slot] == 0:
			numbers.resize(numbers.size() + size)
			continue
		var part: Variant = (value as Dictionary).get(entry.name) if value is Dictionary else null
		if part is PackedFloat32Array and (part as PackedFloat32Array).size() == size:
			numbers.append_array(part)
		else:
			numbers.append_array(_entry_bytes(slot, entry, value).to_float32_array())
	frame.append_array(numbers.to_byte_array())
	LudusWire.pad(frame)


## Bytes of one entry of what the game returned; zeros after noting the error if it does not fit.
func _entry_bytes(slot: int, entry: LudusObservationEntry, value: Variant) -> PackedByteArray:
	var part: Variant = value
	if value is Dictionary:
		part = (value as Dictionary).get(entry.name)
	elif layout.entries.size() > 1:
		part = null
	var bytes := entry.to_bytes(part)
	if bytes.is_empty():
		_fail(slot, 'observation["%s"]' % entry.name, "%d numbers" % entry.size(), part)
		bytes.resize(entry.num_bytes())
	return bytes


func _look_at_types(script: Script) -> void:
	if _are_declared and (script == null or script != _declaring_script):
		_declaring_script = script
		_are_declared = LudusScriptReview.declares_outcomes(script)


func _is_cut(slot: int) -> bool:
	var value: Variant = _targets[slot].is_truncated()
	return value if value is bool else _to_flag(slot, "is_truncated()", value)


func _to_number(slot: int, value: Variant) -> float:
	if typeof(value) in [TYPE_INT, TYPE_BOOL]:
		return float(value)
	_fail(slot, "get_reward()", "a number", value)
	return 0.0


func _to_flag(slot: int, what: String, value: Variant) -> bool:
	if typeof(value) in [TYPE_INT, TYPE_FLOAT]:
		return bool(value)
	_fail(slot, what, "true or false", value)
	return false


func _fail(slot: int, what: String, expected: String, got: Variant) -> void:
	if error.is_empty():
		var found := LudusScriptReview.describe_value(got)
		error = "%s: %s: expected %s, got %s" % [where(slot), what, expected, found]
