extends RefCounted
## What is known of the agent that a [LudusDebugView] shows: what it sees and does, what came of it.
##
## It is filled from what a trainer is sent, or from what a policy in the game is given, so that the
## game itself is not asked once more for an observation, which could draw random numbers.

const LudusPolicyBatch := preload("res://addons/ludus/agent/policy_batch.gd")
const LudusPolicyGroup := preload("res://addons/ludus/policy/policy_group.gd")
const LudusPolicyLayout := preload("res://addons/ludus/agent/policy_layout.gd")
const LudusWire := preload("res://addons/ludus/bridge/wire.gd")

## Steps that the moving lines show.
const MAX_HISTORY := 200

## The agents of one policy, one of which is watched; null where a person plays, or nobody.
var batch: LudusPolicyBatch
## Which of them.
var slot: int = 0
## What it observes and decides.
var entries: Array[LudusObservationEntry] = []
var components: Array[LudusActionComponent] = []
## What it observed last, for each entry; empty as long as it is not known.
var seen: Array[PackedByteArray] = []
## What it chose last: the choices, and the numbers within their bounds.
var choices: PackedInt64Array = []
var numbers: PackedFloat32Array = []
## Probability of each alternative of all choices; empty where nobody tells.
var probabilities: PackedFloat32Array = []
## Mean and deviation of each number, within its bounds; empty where nobody tells.
var means: PackedFloat32Array = []
var deviations: PackedFloat32Array = []
## The return that the critic expects; NaN where nobody tells.
var value: float = NAN
## Sum of the rewards of this episode, as far as they were seen.
var episode_return: float = 0.0
## The last steps: rewards, returns and values.
var rewards: PackedFloat32Array = []
var returns: PackedFloat32Array = []
var values: PackedFloat32Array = []

var _has_ended: bool = false
## Whether it has decided in the step before, as far as that was seen; its reward belongs to that.
var _is_acting: bool = false
## The agent that a person plays.
var _person: LudusAgent


## The declarations of its policy.
func layout() -> LudusPolicyLayout:
	return batch.layout


## The agent; null if it has left the scene.
func agent() -> LudusAgent:
	var found: Variant = _person
	if batch != null:
		found = batch.agents[slot] if slot < batch.agents.size() else null
	return found if is_instance_valid(found) else null


## Watches another agent, of which nothing is known yet.
func watch(policy: LudusPolicyBatch, its_slot: int) -> void:
	batch = policy
	slot = its_slot
	_person = null
	entries = []
	components = []
	if policy != null:
		entries = policy.layout.entries
		components = policy.layout.components
	_is_acting = false
	seen.clear()
	choices.clear()
	numbers.clear()
	forget_decision()
	episode_return = 0.0
	_has_ended = false
	for line: PackedFloat32Array in [rewards, returns, values]:
		line.clear()


## Watches an agent that a person plays.
func watch_person(played: LudusAgent) -> void:
	watch(null, 0)
	_person = played
	components = played.action


## Forgets what was told of the last decision.
func forget_decision() -> void:
	probabilities.clear()
	means.clear()
	deviations.clear()
	value = NAN


## Takes a decision as a trainer tells of it (PROTOCOL.md §8).
func take_decision(told: Dictionary) -> void:
	forget_decision()
	probabilities = _numbers_of(told.get("probabilities"), layout().mask_size)
	means = _numbers_of(told.get("means"), layout().continuous_size)
	deviations = _numbers_of(told.get("deviations"), layout().continuous_size)
	var expected: Variant = told.get("value")
	if expected is float or expected is int:
		value = float(expected)


## Reads the agent's part of a whole frame [code]BATCH[/code] (PROTOCOL.md §7), in which that of its
## policy begins at [param offset]. [param is_reset]: its episode begins.
func read_batch(frame: PackedByteArray, offset: int, is_reset: bool) -> void:
	var num := batch.agents.size()
	seen.clear()
	for entry: LudusObservationEntry in layout().entries:
		var size := entry.num_bytes()
		seen.append(frame.slice(offset + slot * size, offset + (slot + 1) * size))
		offset += LudusWire.padded(num * size)
	var reward := frame.decode_float(offset + slot * 4)
	offset += LudusWire.padded(num * 4)
	var has_ended := frame[offset + slot] + frame[offset + LudusWire.padded(num) + slot] > 0
	if is_reset:
		episode_return = 0.0
		_has_ended = false
	elif _is_acting:
		_note_step(reward, has_ended)
	_is_acting = frame[offset + 2 * LudusWire.padded(num) + slot] == 1


## Reads the agent's part of the payload of a [code]STEP[/code] (PROTOCOL.md §6), in which that of
## its policy begins at [param offset].
func read_actions(payload: PackedByteArray, offset: int) -> void:
	var num_choices := layout().num_discrete
	var size := layout().continuous_size
	var at := offset + slot * num_choices * 8
	choices = payload.slice(at, at + num_choices * 8).to_int64_array()
	at = offset + layout().discrete_bytes(batch.agents.size()) + slot * size * 4
	numbers = payload.slice(at, at + size * 4).to_float32_array()


## Takes what a policy in the game was given and has decided in this tick.
func read_group(group: LudusPolicyGroup) -> void:
	if _is_acting:
		_note_step(batch.reward(slot), slot in batch.final_slots)
	_is_acting = batch.active[slot] == 1
	if not _is_acting:
		return
	seen.clear()
	for i: int in layout().entries.size():
		seen.append(group.entry_bytes(i, slot))
	var decision := group.describe_decision(slot)
	choices = decision["choices"]
	numbers = decision["numbers"]
	take_decision(decision)


## Takes what a person has decided, and asks the game what the agent sees: nobody else does.
func read_person(action: Variant, reward: Variant, has_begun: bool) -> void:
	if has_begun:
		episode_return = 0.0
	if reward is float or reward is int:
		_note_step(float(reward), false)
	var value: Variant = _person.observer.get_observation()
	var by_name: Dictionary = value if value is Dictionary else {"observation": value}
	entries = []
	seen.clear()
	var known := _person.known_entries()
	for key: Variant in by_name:
		var entry := LudusObservationEntry.infer(str(key), by_name[key])
		for declared: LudusObservationEntry in known:
			if declared.name == str(key) or value is not Dictionary:
				entry = declared
		if entry != null:
			entries.append(entry)
			seen.append(entry.to_bytes(by_name[key]))
	_read_action(action)


func _read_action(action: Variant) -> void:
	choices.clear()
	numbers.clear()
	var parts: Array = (action as Dictionary).values() if action is Dictionary else [action]
	for part: Variant in parts:
		if part is int:
			choices.append(part)
		elif part is PackedInt64Array:
			choices.append_array(part)
		else:
			numbers.append_array(LudusObservationEntry.floats(part))


## Bytes of a policy's part of a [code]BATCH[/code], without final observations.
static func count_batch_bytes(policy: LudusPolicyBatch) -> int:
	var num := policy.agents.size()
	var sum := LudusWire.padded(num * 4) + 3 * LudusWire.padded(num)
	for entry: LudusObservationEntry in policy.layout.entries:
		sum += LudusWire.padded(num * entry.num_bytes())
	return sum + LudusWire.padded(num * policy.layout.mask_size)


## A line of the plot breaks where an episode has ended: that step is the last of its return.
func _note_step(reward: float, has_ended: bool) -> void:
	if _has_ended:
		episode_return = 0.0
	_has_ended = has_ended
	episode_return += reward
	_append(rewards, reward)
	_append(returns, episode_return)
	_append(values, value)


static func _append(line: PackedFloat32Array, number: float) -> void:
	line.append(number)
	if line.size() > MAX_HISTORY:
		line.remove_at(0)


static func _numbers_of(told: Variant, size: int) -> PackedFloat32Array:
	if told is PackedFloat32Array:
		return told
	if told is not Array or len(told) != size:
		return PackedFloat32Array()
	return LudusObservationEntry.floats(told)
