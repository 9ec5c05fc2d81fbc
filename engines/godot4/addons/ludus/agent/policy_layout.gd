extends RefCounted
## What all agents of a policy have in common: entries, action components, limits, sizes.

const LudusScriptReview := preload("res://addons/ludus/agent/script_review.gd")
const LudusWire := preload("res://addons/ludus/bridge/wire.gd")

## More alternatives are not counted.
const MAX_COUNTED := 32

## Entries of the observation, in wire order.
var entries: Array[LudusObservationEntry] = []
## Components of the action, in wire order.
var components: Array[LudusActionComponent] = []
## Whether the game has [code]get_action_mask()[/code].
var has_action_mask: bool = false
## Whether the game has [code]is_truncated()[/code].
var has_truncation: bool = false
## Whether the game gets the action in every tick of a step.
var is_every_tick: bool = true
## Steps after which an episode is truncated; 0: never.
var max_steps: int = 0
## Bytes of one agent's action mask.
var mask_size: int = 0
## Number of choices in an action.
var num_discrete: int = 0
## Count of numbers in an action.
var continuous_size: int = 0
## Whether an action is one choice, the quick case: the game gets it as it came.
var is_one_choice: bool = false
## What is wrong with the declarations, or an empty text.
var error: String = ""

## Name and count of numbers of each component; 0: a choice.
var _names: PackedStringArray = []
var _sizes: PackedInt32Array = []
## The fewest alternatives of a choice.
var _fewest_alternatives: int = 1 << 62
var _settings: Dictionary = {}
var _episode: String = "agent"


## Takes over the declarations of an agent. [param max_steps_override] of 0 leaves the limit to it.
## An agent that declares no entries has [param known_entries], or those of its first observation.
func _init(
	first: LudusAgent, max_steps_override: int, known_entries: Array[LudusObservationEntry] = []
) -> void:
	components = first.action
	has_action_mask = first.has_action_mask
	has_truncation = first.has_truncation()
	is_every_tick = first.action_timing == LudusAgent.ActionTiming.EVERY_TICK
	max_steps = max_steps_override if max_steps_override > 0 else first.max_episode_steps
	for part: LudusActionComponent in components:
		_names.append(part.name)
		_sizes.append(0 if part.kind == LudusActionComponent.Kind.DISCRETE else part.size)
		if part.kind == LudusActionComponent.Kind.DISCRETE:
			num_discrete += 1
			mask_size += part.n
			_fewest_alternatives = mini(_fewest_alternatives, part.n)
		else:
			continuous_size += part.size
	is_one_choice = num_discrete == 1 and continuous_size == 0
	var of_sensors := first.known_entries().slice(first.observation.size())
	entries = first.observation.duplicate()
	if entries.is_empty() and first.game_observes():
		entries = _without(known_entries, of_sensors)
		if entries.is_empty():
			entries = _infer_entries(first)
	entries.append_array(of_sensors)
	if first.settings != null:
		_settings = first.settings.to_json()
	if first.world.episode_mode == LudusWorld.Episode.WORLD:
		_episode = "world"


## Whether an observation is one float32 entry, the quick case.
func is_flat() -> bool:
	return entries.size() == 1 and entries[0].dtype == LudusObservationEntry.DType.FLOAT32


## Number of bytes of the actions of [param num_agents] agents (PROTOCOL.md §6).
func action_bytes(num_agents: int) -> int:
	return discrete_bytes(num_agents) + LudusWire.padded(num_agents * continuous_size * 4)


## Number of bytes of their choices.
func discrete_bytes(num_agents: int) -> int:
	return LudusWire.padded(num_agents * num_discrete * 8)


## Whether all choices are choices of the component with the fewest alternatives. A quick look that
## may say no where nothing is wrong: it counts, so that no line of GDScript runs per agent.
func are_all_choices(discrete: PackedInt64Array) -> bool:
	if num_discrete == 0:
		return true
	var num_found := 0
	for choice: int in mini(_fewest_alternatives, MAX_COUNTED):
		num_found += discrete.count(choice)
	return num_found == discrete.size()


## Says which choice of a slot is none, or returns an empty text.
func find_wrong_choice(slot: int, discrete: PackedInt64Array) -> String:
	var i := slot * num_discrete
	for part: LudusActionComponent in components:
		if part.kind != LudusActionComponent.Kind.DISCRETE:
			continue
		if discrete[i] < 0 or discrete[i] >= part.n:
			return "action %s: expected 0 to %d, got %d" % [part.name, part.n - 1, discrete[i]]
		i += 1
	return ""


## Puts the actions of the slots [param acting] into [param actions], as the game gets them. They
## are new ones in each step, as the game may keep what it gets.
func unpack_actions(
	acting: PackedInt32Array,
	discrete: PackedInt64Array,
	continuous: PackedFloat32Array,
	actions: Array[Variant]
) -> void:
	for slot: int in acting:
		if continuous_size == 0:
			actions[slot] = discrete.slice(slot * num_discrete, (slot + 1) * num_discrete)
		elif num_discrete == 0:
			actions[slot] = continuous.slice(slot * continuous_size, (slot + 1) * continuous_size)
		else:
			actions[slot] = _mixed_action(slot, discrete, continuous)


func _mixed_action(
	slot: int, discrete: PackedInt64Array, continuous: PackedFloat32Array
) -> Dictionary:
	var by_name := {}
	var next_choice := slot * num_discrete
	var next_number := slot * continuous_size
	for i: int in _names.size():
		var size := _sizes[i]
		if size == 0:
			by_name[_names[i]] = discrete[next_choice]
			next_choice += 1
		else:
			by_name[_names[i]] = continuous.slice(next_number, next_number + size)
			next_number += size
	return by_name


## Draws choices for [param num_agents] agents.
func random_choices(num_agents: int, rng: RandomNumberGenerator) -> PackedInt64Array:
	var choices: PackedInt64Array = []
	for i: int in num_agents:
		for part: LudusActionComponent in components:
			if part.kind == LudusActionComponent.Kind.DISCRETE:
				choices.append(rng.randi() % part.n)
	return choices


## Draws numbers within their bounds for [param num_agents] agents.
func random_numbers(num_agents: int, rng: RandomNumberGenerator) -> PackedFloat32Array:
	var numbers: PackedFloat32Array = []
	if continuous_size == 0:
		return numbers
	for i: int in num_agents:
		for part: LudusActionComponent in components:
			if part.kind == LudusActionComponent.Kind.CONTINUOUS:
				for k: int in part.size:
					numbers.append(rng.randf_range(part.low, part.high))
	return numbers


## Describes the policy for the handshake (PROTOCOL.md §4), but for its agents.
func to_json() -> Dictionary:
	var observation: Array[Dictionary] = []
	for entry: LudusObservationEntry in entries:
		observation.append(entry.to_json())
	var action: Array[Dictionary] = []
	for part: LudusActionComponent in components:
		action.append(part.to_json())
	return {
		"episode": _episode,
		"max_episode_steps": max_steps if max_steps > 0 else null,
		"observation": observation,
		"action": action,
		"has_action_mask": has_action_mask,
		"settings": _settings,
	}


static func _without(
	known: Array[LudusObservationEntry], others: Array[LudusObservationEntry]
) -> Array[LudusObservationEntry]:
	var names := others.map(func(entry: LudusObservationEntry) -> String: return entry.name)
	return known.filter(func(entry: LudusObservationEntry) -> bool: return entry.name not in names)


func _infer_entries(first: LudusAgent) -> Array[LudusObservationEntry]:
	first.target.reset()
	var value: Variant = first.target.get_observation()
	var inferred: Array[LudusObservationEntry] = []
	if value is not Dictionary:
		value = {"observation": value}
	for key: Variant in value:
		var entry := LudusObservationEntry.infer(str(key), value[key])
		if entry == null or entry.size() == 0:
			error = (
				'agent %s: get_observation() returned no numbers for entry "%s", but %s'
				% [
					first.path_in_world() + LudusScriptReview.place_of(first.target),
					key,
					LudusScriptReview.describe_value(value[key])
				]
			)
			return []
		inferred.append(entry)
	if inferred.is_empty():
		error = "agent %s: get_observation() returned an empty dictionary" % first.path_in_world()
	return inferred
