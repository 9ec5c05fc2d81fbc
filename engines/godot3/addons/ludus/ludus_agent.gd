tool
class_name LudusAgent, "res://addons/ludus/icons/ludus_agent.svg"
extends Node
## Makes a node of the game an agent.
##
## Put it under the node that has the five methods [code]apply_action(action)[/code],
## [code]get_observation()[/code], [code]get_reward()[/code], [code]is_done()[/code] and
## [code]reset()[/code] (or point [member target_path] at it); or extend this script and write the
## methods there. Optional methods, used where they are:
## [code]get_action_mask() -> PoolByteArray[/code], one byte per alternative, 1 = allowed;
## [code]is_truncated() -> bool[/code]; and [code]get_manual_action()[/code], which lets a person
## play while no trainer is there.
##
## An action arrives as an [int] (one choice), a [PoolIntArray] (several choices), a
## [PoolRealArray] (numbers), or a dictionary of component name to [int] or [PoolRealArray] (both
## kinds). An observation is a flat array of numbers, or a dictionary of entry name to array or
## [Image].

## When an action is handed to the game: in every tick of the step, or in the first one only.
enum ActionTiming { EVERY_TICK, ONCE }

const GROUP_NAME := "ludus_agents"
const REQUIRED_METHODS := ["apply_action", "get_observation", "get_reward", "is_done", "reset"]
## Godot 3 has no static variables; what a constant dictionary holds is shared all the same.
const _CHANGES := {"count": 0}

## Agents with one policy name share a network.
export var policy_name: String = "agent"
## The node that has the five methods; empty: the parent.
export var target_path: NodePath
## What the agent sees, as [LudusObservationEntry]. Empty: taken from the first observation, as
## float32 without bounds.
export(Array, Resource) var observation: Array = []
## What the agent decides, as [LudusActionComponent].
export(Array, Resource) var action: Array = []
## Physics ticks per decision; the same for all agents of the game.
export(int, 1, 1000) var ticks_per_step: int = 2
## Whether the game gets the action in every tick of a step or only in the first.
export(ActionTiming) var action_timing: int = ActionTiming.EVERY_TICK
## Steps after which an episode is cut off (truncated); 0: never.
export(int, 0, 1000000) var max_episode_steps: int = 0
## Whether the game must have [code]get_action_mask()[/code]. The method is used in any case.
export var has_action_mask: bool = false
## An agent that is not enabled takes no part.
export var enabled: bool = true setget set_enabled
## Training settings of the policy ([LudusPolicySettings]); null: the trainer's choice.
export var settings: Resource
## The trained policy ([LudusPolicy]) that plays the agent while no trainer is there.
export var policy: Resource setget set_policy
## Whether the policy draws its actions, as in training, instead of taking the most probable ones.
export var sample_actions: bool = false

## What has the five methods: a node.
var target: Object
## The world this agent lives in.
var world: LudusWorld
## Steps since the episode began.
var episode_steps: int setget set_episode_steps, get_episode_steps

## The [LudusPolicyBatch] that counts the steps.
var _batch: Reference
var _slot: int = -1
var _manual_steps: int = 0


## Godot 3 lets all instances share the default of an exported array or dictionary.
func _init() -> void:
	observation = []
	action = []


## Takes the former name of `sample_actions`, from scenes that have it.
func _set(property: String, value) -> bool:
	if property != "is_sampling":
		return false
	sample_actions = value
	return true


func _enter_tree() -> void:
	add_to_group(GROUP_NAME)
	get_tree().call_group("ludus_bridges", "wake")
	note_change()
	var own_world := LudusWorld.find_above(self)
	if own_world != null:
		own_world.newcomers[self] = true
		LudusWorld.announce(LudusWorld.NEWCOMERS)


func _exit_tree() -> void:
	var own_world := LudusWorld.find_above(self)
	if own_world != null:
		var _was_there := own_world.newcomers.erase(self)
	LudusWorld.announce(LudusWorld.LEAVERS)
	note_change()


## Goes up whenever an agent comes, goes, or is to be played by something else.
static func num_changes() -> int:
	return _CHANGES["count"]


## Notes that an agent came, went, or is to be played by something else.
static func note_change() -> void:
	_CHANGES["count"] += 1


func set_enabled(value: bool) -> void:
	enabled = value
	note_change()


func set_policy(value: Resource) -> void:
	policy = value
	note_change()
	update_configuration_warning()


## Finds target and world. Returns what is wrong with the agent, or an empty text.
func connect_to_game() -> String:
	target = _find_target()
	if target == null:
		return "target_path %s leads nowhere" % target_path
	for method in REQUIRED_METHODS:
		if not target.has_method(method):
			return "%s has no method %s()" % [_describe(target), method]
	if has_action_mask and not target.has_method("get_action_mask"):
		return "has_action_mask is on, but %s has no method get_action_mask()" % _describe(target)
	if action.empty():
		return "no action is declared: add a LudusActionComponent to `action`"
	has_action_mask = has_mask()
	if _has_foreign_items():
		return "an item of `action` or `observation`, or `policy`, is empty or of another kind"
	world = LudusWorld.of(self)
	return ""


## Whether actions are masked: the game has [code]get_action_mask()[/code].
func has_mask() -> bool:
	return has_action_mask or _target_has("get_action_mask")


## Tells the agent which batch counts its steps.
func join_batch(batch: Reference, slot: int) -> void:
	_batch = batch
	_slot = slot


## Whether a batch has the agent in a slot.
func is_in_batch() -> bool:
	return _batch != null and _batch.agents[_slot] == self


## Whether the agent is about to leave the scene.
func is_leaving() -> bool:
	if is_queued_for_deletion() or target.is_queued_for_deletion():
		return true
	return world.root != target and world.root.is_queued_for_deletion()


## Whether the game has [code]is_truncated()[/code].
func has_truncation() -> bool:
	return target.has_method("is_truncated")


## Whether the game has [code]get_manual_action()[/code].
func has_manual_action() -> bool:
	return target.has_method("get_manual_action")


## Path inside the world, for messages.
func path_in_world() -> String:
	var own_world := world if world != null else LudusWorld.find_above(self)
	return str(own_world.root.get_path_to(self)) if own_world != null else str(get_path())


func set_episode_steps(value: int) -> void:
	_manual_steps = value


func get_episode_steps() -> int:
	return _batch.episode_steps(_slot) if _batch != null else _manual_steps


func _find_target() -> Object:
	if has_method(REQUIRED_METHODS[0]):
		return self
	return get_parent() if target_path.is_empty() else get_node_or_null(target_path)


## Whether the target has a method; in the editor, where it does not run, by its script.
func _target_has(method: String) -> bool:
	var node := _find_target()
	if node == null or node.has_method(method):
		return node != null
	return node.get_script() != null and method in _methods_of(node.get_script())


func _describe(node: Object) -> String:
	var script: Script = node.get_script()
	return "%s (%s)" % [node.name, script.resource_path if script != null else node.get_class()]


## Godot 3 lets any resource into an exported array.
func _has_foreign_items() -> bool:
	for component in action:
		if not component is LudusActionComponent:
			return true
	for entry in observation:
		if not entry is LudusObservationEntry:
			return true
	if policy != null and not policy is LudusPolicy:
		return true
	return settings != null and not settings is LudusPolicySettings


func _get_configuration_warning() -> String:
	var warnings := PoolStringArray()
	if policy_name.empty():
		warnings.append("policy_name is empty.")
	if action.empty():
		warnings.append("No action is declared: add a LudusActionComponent to `action`.")
	if _has_foreign_items():
		warnings.append(
			(
				"`action`, `observation`, `settings` or `policy` has "
				+ "an item that is empty or of another kind."
			)
		)
	elif policy != null and not policy.incompatibility(self).empty():
		warnings.append("The policy does not fit: %s." % policy.incompatibility(self))
	for component in action:
		if component is LudusActionComponent and not component.is_valid():
			warnings.append("Action %s: low must be below high, n at least 1." % component.name)
	var node := _find_target()
	if node == null:
		warnings.append("target_path leads nowhere.")
	elif node != self and node.get_script() == null:
		warnings.append("%s has no script with the five methods." % node.name)
	elif node.get_script() != null:
		warnings.append_array(_method_warnings(node.get_script()))
	return warnings.join("\n")


func _method_warnings(script: Script) -> PoolStringArray:
	var names := _methods_of(script)
	var warnings := PoolStringArray()
	for method in REQUIRED_METHODS:
		if not method in names:
			warnings.append("The target has no method %s()." % method)
	if has_action_mask and not "get_action_mask" in names:
		warnings.append("has_action_mask is on, but the target has no method get_action_mask().")
	return warnings


## Names of a script's methods, those of the scripts that it extends included.
func _methods_of(script: Script) -> Array:
	var names := []
	var base := script
	while base != null:
		for method in base.get_script_method_list():
			names.append(method["name"])
		base = base.get_base_script()
	return names
