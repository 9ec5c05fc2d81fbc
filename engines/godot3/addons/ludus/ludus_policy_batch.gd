# gdlint: disable=max-public-methods
class_name LudusPolicyBatch
extends Reference
## All agents of one policy in slots: hands out their actions, puts their observations together.
##
## This is the hot path: pool arrays, no text, no dictionary unless the game itself uses one.

const NO_LIMIT := 1 << 62

## Name of the policy.
var policy_name: String
## What all agents have in common.
var layout: LudusPolicyLayout
## The agent in each slot; null in a free slot.
var agents: Array = []
## Which slots act on the observation that is sent next. Pool arrays are copied where another
## object takes them: change it through the methods here.
var active := PoolByteArray()
## Slots whose episode ended in the last step.
var final_slots := PoolIntArray()
## What is wrong with the game, or an empty text. Set once; the run fails with it.
var error: String = ""
## Whether each agent is alone in its world: then nobody's next episode changes what another one
## sees, and who goes on is observed together with the outcomes of the step. To come back to all
## agents later costs cold caches.
var are_alone: bool = false

## The nodes that have the five methods, beside [member agents].
var _targets: Array = []
## Numbers in an observation that is one float32 entry; -1 if it is more than that.
var _flat_size: int = -1
var _lost: LudusLostTarget
var _slot_worlds := PoolIntArray()
var _discrete: Array = []
var _continuous: Array = []
var _steps := PoolIntArray()
var _rewards := PoolRealArray()
var _terminated := PoolByteArray()
var _truncated := PoolByteArray()
var _final_parts: Array = []
## In place of those, if an observation is one float32 entry.
var _final_numbers := PoolRealArray()
## What the agents see who went on after the last step, zeros for the others; empty if nobody was
## observed with it.
var _seen := PoolRealArray()
## Slots that have begun an episode since.
var _begun: Array = []
## An observation of zeros, if it is one float32 entry.
var _zeros := PoolRealArray()


## Takes the agents of all worlds in slot order, null for a spare slot, and the world of each slot;
## the rest is for [LudusPolicyLayout].
func _init(
	name: String,
	members: Array,
	worlds: PoolIntArray,
	max_steps_override: int,
	known_entries: Array = []
) -> void:
	policy_name = name
	_slot_worlds = worlds
	layout = LudusPolicyLayout.new(members[0], max_steps_override, known_entries)
	error = layout.error
	_lost = LudusLostTarget.new(layout.entries)
	if layout.is_flat():
		_flat_size = layout.entries[0].size()
		_zeros.resize(_flat_size)
		_zeros.fill(0.0)
	var _is_filled := replace_agents(members)


## Describes the policy for the handshake (PROTOCOL.md §4).
func to_json(agents_per_world: int) -> Dictionary:
	var slots := []
	for slot in agents.size():
		var path = agents[slot].path_in_world() if agents[slot] != null else null
		slots.append({"world": _slot_worlds[slot], "path": path})
	var description := layout.to_json()
	description["name"] = policy_name
	description["num_agents"] = agents.size()
	description["agents_per_world"] = agents_per_world
	description["agents"] = slots
	return description


## Fills all slots anew, as at the beginning. Returns false if the number of agents has changed.
func replace_agents(members: Array) -> bool:
	if not agents.empty() and members.size() != agents.size():
		return false
	var num := members.size()
	agents.resize(num)
	_targets.resize(num)
	_steps.resize(num)
	active.resize(num)
	_rewards.resize(num)
	_terminated.resize(num)
	_truncated.resize(num)
	for slot in num:
		set_agent(slot, members[slot])
	clear_outcomes()
	return true


## Puts an agent into a slot, not yet active; null frees the slot.
func set_agent(slot: int, agent: LudusAgent) -> void:
	agents[slot] = agent
	active[slot] = 0
	_steps[slot] = 0
	_targets[slot] = _lost
	if agent != null:
		_targets[slot] = agent.target
		agent.join_batch(self, slot)


## Makes the agent of a slot act from the next observation on.
func activate(slot: int) -> void:
	active[slot] = 1
	_steps[slot] = 0
	_begun.append(slot)


## Makes all slots act.
func activate_all() -> void:
	active.fill(1)


## Steps since the episode of a slot began.
func episode_steps(slot: int) -> int:
	return _steps[slot]


## Replaces agents that have left the scene by stand-ins, which end in this step.
func drop_leavers() -> void:
	for slot in agents.size():
		if not is_instance_valid(agents[slot]) or not agents[slot].is_inside_tree():
			agents[slot] = null
			_targets[slot] = _lost


## Number of bytes of this policy's part of a [code]STEP[/code].
func action_bytes() -> int:
	return layout.action_bytes(agents.size())


## Adds a free slot and returns it.
func add_slot() -> int:
	var slot := agents.size()
	agents.append(null)
	_targets.append(_lost)
	_steps.append(0)
	active.append(0)
	_rewards.append(0.0)
	_terminated.append(0)
	_truncated.append(0)
	_slot_worlds.append(0)
	return slot


## Reward of a slot in the last step.
func reward(slot: int) -> float:
	return _rewards[slot]


## Reads the actions from a [code]STEP[/code] at [param offset]. Returns the offset of what follows.
func read_actions(payload: PoolByteArray, offset: int) -> int:
	var num_choices := agents.size() * layout.num_discrete
	if num_choices > 0:
		_discrete = LudusWire.read_choices(payload, offset, num_choices)
		offset += num_choices * 8
	var num_numbers := agents.size() * layout.continuous_size
	if num_numbers > 0:
		_continuous = Array(LudusWire.read_floats(payload, offset, num_numbers))
		offset += LudusWire.padded(num_numbers * 4)
	return offset


## Says which choice of an agent that acts is none, or returns an empty text.
func find_wrong_choice() -> String:
	if layout.are_all_choices(_discrete):
		return ""
	for slot in active.size():
		var problem: String = layout.find_wrong_choice(slot, _discrete) if active[slot] == 1 else ""
		if not problem.empty():
			return "STEP, policy %s, slot %d, %s" % [policy_name, slot, problem]
	return ""


## Hands the actions that were read to the game.
func hand_out_actions() -> void:
	_apply()


## Hands actions of all slots to the game.
func set_actions(discrete: Array, continuous: Array) -> void:
	_discrete = discrete
	_continuous = continuous
	_apply()


## Hands the game the same actions again, in the later ticks of a step.
func repeat_actions() -> void:
	if layout.is_every_tick:
		_apply()


## Collects what the last step brought: rewards, ends of episodes and final observations. Agents
## whose episode has ended are left inactive; [LudusGame] begins the next one.
func collect_outcomes() -> void:
	clear_outcomes()
	var limit := layout.max_steps if layout.max_steps > 0 else NO_LIMIT
	var has_truncation := layout.has_truncation
	var is_observing := are_alone and _flat_size >= 0
	var size := _flat_size
	for slot in _targets.size():
		if active[slot] == 0:
			if is_observing:
				_seen.append_array(_zeros)
			continue
		var target = _targets[slot]
		var steps := _steps[slot] + 1
		_steps[slot] = steps
		_rewards[slot] = target.get_reward()
		if target.is_done():
			_terminated[slot] = 1
			_end(slot)
		elif steps >= limit or (has_truncation and target.is_truncated()):
			_truncated[slot] = 1
			_end(slot)
		elif is_observing:
			var value = target.get_observation()
			if value is PoolRealArray and value.size() == size:
				_seen.append_array(value)
			else:
				_seen.append_array(_flat_numbers(slot, value))
			continue
		if is_observing:
			_seen.append_array(_zeros)


## Forgets the outcomes of the last step.
func clear_outcomes() -> void:
	_rewards.fill(0.0)
	_terminated.fill(0)
	_truncated.fill(0)
	final_slots.resize(0)
	_final_numbers.resize(0)
	_seen.resize(0)
	_begun.clear()
	if _flat_size < 0:
		_final_parts.clear()
		for _i in layout.entries.size():
			_final_parts.append(PoolByteArray())


## This policy's part of a [code]BATCH[/code] (PROTOCOL.md §7), without final observations.
func to_bytes() -> PoolByteArray:
	var bytes: PoolByteArray
	if _flat_size >= 0:
		var numbers := _observe_all()
		if numbers.size() & 1:
			numbers.append(0.0)
		numbers.append_array(_rewards)
		bytes = LudusWire.pad(LudusWire.float_bytes(numbers))
	else:
		bytes = _entries_to_bytes()
		bytes.append_array(LudusWire.pad(LudusWire.float_bytes(_rewards)))
	for flags in [_terminated, _truncated, active]:
		bytes.append_array(LudusWire.pad(flags))
	if layout.has_action_mask:
		bytes.append_array(masks_to_bytes())
	return bytes


## The entries of what all slots observe, one after the other, each padded.
func observations_to_bytes() -> PoolByteArray:
	if _flat_size >= 0:
		return LudusWire.pad(LudusWire.float_bytes(_observe_all()))
	return _entries_to_bytes()


## The action masks of all slots, padded; inactive slots may do everything.
func masks_to_bytes() -> PoolByteArray:
	var free := PoolByteArray()
	free.resize(layout.mask_size)
	free.fill(1)
	var bytes := PoolByteArray()
	for slot in _targets.size():
		var mask = _targets[slot].get_action_mask() if active[slot] == 1 else free
		if not mask is PoolByteArray or mask.size() != layout.mask_size:
			_fail(slot, "get_action_mask()", "%d bytes" % layout.mask_size, mask)
			mask = free
		bytes.append_array(mask)
	return LudusWire.pad(bytes)


## This policy's final observations (PROTOCOL.md §7).
func final_to_bytes() -> PoolByteArray:
	var head := PoolIntArray([final_slots.size(), 0])
	head.append_array(final_slots)
	var bytes := LudusWire.pad(LudusWire.int_bytes(head))
	if final_slots.empty():
		return bytes
	if _flat_size >= 0:
		bytes.append_array(LudusWire.pad(LudusWire.float_bytes(_final_numbers)))
	for part in _final_parts:
		bytes.append_array(LudusWire.pad(part))
	return bytes


## Plays one step with random actions, as the ceiling that [code]run_ceiling[/code] measures: all
## that the game itself does, nothing of the bridge.
func play_randomly(rng: RandomNumberGenerator) -> void:
	var limit := layout.max_steps if layout.max_steps > 0 else NO_LIMIT
	var has_truncation := layout.has_truncation
	for slot in _targets.size():
		var target = _targets[slot]
		active[slot] = int(target != _lost)
		if target == _lost:
			continue
		var steps := _steps[slot] + 1
		target.get_reward()
		if target.is_done() or steps >= limit or (has_truncation and target.is_truncated()):
			steps = 0
			agents[slot].world.begin_episode()
			target.reset()
		_steps[slot] = steps
		target.get_observation()
	var num := agents.size()
	set_actions(layout.random_choices(num, rng), layout.random_numbers(num, rng))


## Names world, agent and step of a slot.
func where(slot: int) -> String:
	var agent: LudusAgent = agents[slot]
	if agent == null:
		return "policy %s, slot %d" % [policy_name, slot]
	return "world %d, agent %s, step %d" % [_slot_worlds[slot], agent.path_in_world(), _steps[slot]]


func _apply() -> void:
	if layout.num_discrete == 1 and layout.continuous_size == 0:
		for slot in _targets.size():
			if active[slot] == 1:
				_targets[slot].apply_action(_discrete[slot])
		return
	for slot in _targets.size():
		if active[slot] == 1:
			_targets[slot].apply_action(layout.action_of(slot, _discrete, _continuous))


func _end(slot: int) -> void:
	active[slot] = 0
	final_slots.append(slot)
	var value = _targets[slot].get_observation()
	if _flat_size >= 0:
		_final_numbers.append_array(_flat_numbers(slot, value))
		return
	for i in layout.entries.size():
		var part: PoolByteArray = _final_parts[i]
		part.append_array(_entry_bytes(slot, layout.entries[i], value))
		_final_parts[i] = part


## What all slots see, if an observation is one float32 entry.
func _observe_all() -> PoolRealArray:
	if not _seen.empty():
		_observe_beginners()
		return _seen
	var numbers := PoolRealArray()
	var size := _flat_size
	for slot in _targets.size():
		if active[slot] == 0:
			numbers.append_array(_zeros)
			continue
		var value = _targets[slot].get_observation()
		if value is PoolRealArray and value.size() == size:
			numbers.append_array(value)
		else:
			numbers.append_array(_flat_numbers(slot, value))
	return numbers


func _observe_beginners() -> void:
	for slot in _begun:
		if active[slot] == 1:
			var value := _flat_numbers(slot, _targets[slot].get_observation())
			for i in _flat_size:
				_seen[slot * _flat_size + i] = value[i]


func _entries_to_bytes() -> PoolByteArray:
	var values := []
	for slot in _targets.size():
		values.append(_targets[slot].get_observation() if active[slot] == 1 else null)
	var bytes := PoolByteArray()
	for entry in layout.entries:
		var part := PoolByteArray()
		for slot in _targets.size():
			if active[slot] == 1:
				part.append_array(_entry_bytes(slot, entry, values[slot]))
			else:
				part.append_array(LudusWire.zeros(entry.num_bytes()))
		bytes.append_array(LudusWire.pad(part))
	return bytes


## The numbers of a flat observation; zeros after noting the error if it does not fit.
func _flat_numbers(slot: int, value) -> PoolRealArray:
	if value is PoolRealArray and value.size() == _flat_size:
		return value
	var bytes := _entry_bytes(slot, layout.entries[0], value)
	return LudusWire.read_floats(bytes, 0, _flat_size)


## Bytes of one entry of what the game returned; zeros after noting the error if it does not fit.
func _entry_bytes(slot: int, entry: LudusObservationEntry, value) -> PoolByteArray:
	var part = value
	if value is Dictionary:
		part = value.get(entry.name)
	elif layout.entries.size() > 1:
		part = null
	var bytes := entry.to_bytes(part)
	if bytes.empty():
		_fail(slot, 'observation["%s"]' % entry.name, "%d numbers" % entry.size(), part)
		bytes.resize(entry.num_bytes())
		bytes.fill(0)
	return bytes


func _fail(slot: int, what: String, expected: String, got) -> void:
	if error.empty():
		var found := LudusObservationEntry.describe_value(got)
		error = "%s: %s: expected %s, got %s" % [where(slot), what, expected, found]
