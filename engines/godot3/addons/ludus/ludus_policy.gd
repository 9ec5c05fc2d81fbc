tool
class_name LudusPolicy, "res://addons/ludus/icons/ludus_policy.svg"
extends Resource
## A trained policy, to be played inside the game (POLICY.md).
##
## [code]ludus export RUN --to hero.ludus.json[/code] writes the file; put it into the project, give
## its path to a LudusPolicy as its [member model], and that to [member LudusAgent.policy]. Agents
## with the same LudusPolicy are computed together.

const MAX_FILE_BYTES := 268435456

## Path of the exported file: [code]res://[/code], [code]user://[/code] or absolute. Godot 3 packs
## it into an exported game only if the export preset's filter for other files has
## [code]*.ludus.json[/code].
export(String, FILE, "*.json") var model: String = "" setget set_model

## What is wrong with the file, or an empty text.
var error: String setget , get_error
## Name of the policy that was trained.
var policy_name: String setget , get_policy_name
## Hash of the spec it was trained for, for information.
var fingerprint: String setget , get_fingerprint

var _read: LudusPolicyReader
var _network: LudusPolicyNetwork


## Loads a policy file from [code]res://[/code], [code]user://[/code] or an absolute path. Mistakes
## stand in [member error].
static func load_file(path: String) -> Resource:
	# A class of Godot 3 cannot name itself.
	var policy: Resource = load("res://addons/ludus/ludus_policy.gd").new()
	policy.model = path
	policy.reader()
	return policy


func set_model(value: String) -> void:
	model = value
	_read = null
	_network = null
	emit_changed()


func get_error() -> String:
	return reader().error


func get_policy_name() -> String:
	return reader().policy_name


func get_fingerprint() -> String:
	return reader().fingerprint


## What the file says. It is parsed once.
func reader() -> LudusPolicyReader:
	if _read == null:
		_read_model()
	return _read


## The network, packed once; null if the file is wrong.
func network() -> LudusPolicyNetwork:
	if _network == null and get_error().empty():
		_network = LudusPolicyNetwork.new(reader())
	return _network


## Says why an agent, a [LudusAgent], cannot use the policy with its declarations; an empty text if
## it can. An agent that declares no entries is not asked about them.
func incompatibility(agent: Node) -> String:
	if not get_error().empty():
		return get_error()
	if not agent.observation.empty():
		for entry in _read.entries:
			var problem := _entry_incompatibility(entry, agent.observation)
			if not problem.empty():
				return problem
	if agent.action.size() != _read.components.size():
		return (
			"the policy decides %d action components, the agent has %d"
			% [_read.components.size(), agent.action.size()]
		)
	var next_number := 0
	for i in _read.components.size():
		var part: LudusActionComponent = _read.components[i]
		var problem := _action_incompatibility(part, agent.action[i], next_number)
		if not problem.empty():
			return problem
		if part.kind == LudusActionComponent.Kind.CONTINUOUS:
			next_number += part.size
	if _read.has_action_mask and not agent.has_mask():
		return "the policy was trained with get_action_mask(), which the game lacks"
	return ""


static func _entry_incompatibility(entry: LudusObservationEntry, declared: Array) -> String:
	for own in declared:
		if own == null or own.name != entry.name:
			continue
		if own.dtype == entry.dtype and Array(own.shape) == Array(entry.shape):
			return ""
		return (
			'observation["%s"]: the policy was trained on %s %s, the agent has %s %s'
			% [
				entry.name,
				LudusObservationEntry.DTYPE_NAMES[entry.dtype],
				Array(entry.shape),
				LudusObservationEntry.DTYPE_NAMES[own.dtype],
				Array(own.shape),
			]
		)
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
	for i in range(first, first + part.size):
		var low: float = _read.low[i]
		var high: float = _read.high[i]
		if not is_equal_approx(low, own.low) or not is_equal_approx(high, own.high):
			return (
				'action["%s"]: the policy was trained for %s to %s, the agent has %s to %s'
				% [part.name, low, high, own.low, own.high]
			)
	return ""


func _read_model() -> void:
	var file := File.new()
	if model.empty():
		_refuse("no model is chosen")
	elif file.open(model, File.READ) != OK:
		_refuse("cannot read %s" % model)
	elif file.get_len() > MAX_FILE_BYTES:
		_refuse("%s has more than %d bytes" % [model, MAX_FILE_BYTES])
	else:
		var json := JSON.parse(file.get_as_text())
		if json.error != OK:
			_refuse("%s is not JSON, line %d: %s" % [model, json.error_line, json.error_string])
		else:
			_read = LudusPolicyReader.new(json.result)


func _refuse(what: String) -> void:
	_read = LudusPolicyReader.new({})
	_read.error = what
