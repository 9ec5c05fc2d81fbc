@tool
@icon("res://addons/ludus/icons/ludus_policy.svg")
class_name LudusPolicy
extends Resource
## A trained policy, to be played inside the game (POLICY.md).
##
## [code]ludus export RUN --to hero.ludus.json[/code] writes the file; put it into the project, give
## it to a LudusPolicy as its [member model], and that to [member LudusAgent.policy]. Agents with
## the same LudusPolicy are computed together.

const LudusPolicyNetwork := preload("res://addons/ludus/policy/policy_network.gd")
const LudusPolicyReader := preload("res://addons/ludus/policy/policy_reader.gd")

const MAX_FILE_BYTES := 268435456

## The exported file.
@export var model: JSON:
	set(value):
		model = value
		_read = null
		_network = null
		emit_changed()

## What is wrong with the file, or an empty text.
var error: String:
	get:
		return reader().error
## Name of the policy that was trained.
var policy_name: String:
	get:
		return reader().policy_name
## Hash of the spec it was trained for, for information.
var fingerprint: String:
	get:
		return reader().fingerprint

var _read: LudusPolicyReader
var _network: LudusPolicyNetwork


## Loads a policy file from [code]res://[/code], [code]user://[/code] or an absolute path. Mistakes
## stand in [member error].
static func load_file(path: String) -> LudusPolicy:
	var policy := LudusPolicy.new()
	if path.begins_with("res://") and ResourceLoader.exists(path):
		policy.model = load(path) as JSON
		return policy
	var file := FileAccess.open(path, FileAccess.READ)
	if file == null:
		policy._refuse("cannot read %s: %s" % [path, error_string(FileAccess.get_open_error())])
	elif file.get_length() > MAX_FILE_BYTES:
		policy._refuse("%s has more than %d bytes" % [path, MAX_FILE_BYTES])
	else:
		var json := JSON.new()
		if json.parse(file.get_as_text()) == OK:
			policy.model = json
		else:
			policy._refuse(
				(
					"%s is not JSON, line %d: %s"
					% [path, json.get_error_line(), json.get_error_message()]
				)
			)
	return policy


## What the file says. It is parsed once.
func reader() -> LudusPolicyReader:
	if _read == null:
		_read = LudusPolicyReader.new(model.data if model != null else {})
		if model == null:
			_read.error = "no model is chosen"
	return _read


## The network, packed once; null if the file is wrong.
func network() -> LudusPolicyNetwork:
	if _network == null and error.is_empty():
		_network = LudusPolicyNetwork.new(reader())
	return _network


## Says why an agent with these declarations and sensors cannot use the policy; an empty text if it
## can. Where it declares no entries, the game may return more of them than are known.
func incompatibility(agent: LudusAgent) -> String:
	if not error.is_empty():
		return error
	var read := reader()
	var known := agent.known_entries()
	var may_have_more := agent.observation.is_empty() and agent.game_observes()
	for entry: LudusObservationEntry in read.entries:
		var problem := _entry_incompatibility(entry, known, may_have_more)
		if not problem.is_empty():
			return problem
	if agent.action.size() != read.components.size():
		return (
			"the policy decides %d action components, the agent has %d"
			% [read.components.size(), agent.action.size()]
		)
	var next_number := 0
	for i: int in read.components.size():
		var part := read.components[i]
		var size := part.size if part.kind == LudusActionComponent.Kind.CONTINUOUS else 0
		var problem := _action_incompatibility(part, agent.action[i], next_number)
		if not problem.is_empty():
			return problem
		next_number += size
	if read.has_action_mask and not agent.has_mask():
		return "the policy was trained with get_action_mask(), which the game lacks"
	return ""


static func _entry_incompatibility(
	entry: LudusObservationEntry, known: Array[LudusObservationEntry], may_have_more: bool
) -> String:
	for own: LudusObservationEntry in known:
		if own == null or own.name != entry.name:
			continue
		if own.dtype == entry.dtype and own.shape == entry.shape:
			return ""
		return (
			'observation["%s"]: the policy was trained on %s %s, the agent has %s %s'
			% [
				entry.name,
				LudusObservationEntry.DTYPE_NAMES[entry.dtype],
				entry.shape,
				LudusObservationEntry.DTYPE_NAMES[own.dtype],
				own.shape
			]
		)
	if may_have_more:
		return ""
	return 'observation["%s"]: the policy needs this entry, the agent has none' % entry.name


func _action_incompatibility(
	part: LudusActionComponent, own: LudusActionComponent, first: int
) -> String:
	if own == null or own.name != part.name or own.kind != part.kind:
		return (
			'action["%s"]: the policy decides this component, the agent has %s in its place'
			% [part.name, "nothing" if own == null else '"%s"' % own.name]
		)
	if part.kind == LudusActionComponent.Kind.DISCRETE:
		if own.n == part.n:
			return ""
		return (
			'action["%s"]: the policy chooses among %d, the agent has %d'
			% [part.name, part.n, own.n]
		)
	if own.size != part.size:
		return (
			'action["%s"]: the policy decides %d numbers, the agent has %d'
			% [part.name, part.size, own.size]
		)
	for i: int in range(first, first + part.size):
		var low := reader().low[i]
		var high := reader().high[i]
		if not is_equal_approx(low, own.low) or not is_equal_approx(high, own.high):
			return (
				'action["%s"]: the policy was trained for %s to %s, the agent has %s to %s'
				% [part.name, low, high, own.low, own.high]
			)
	return ""


func _refuse(what: String) -> void:
	_read = LudusPolicyReader.new({})
	_read.error = what
