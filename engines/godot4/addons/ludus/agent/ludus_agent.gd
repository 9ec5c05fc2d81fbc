@tool
@icon("res://addons/ludus/icons/ludus_agent.svg")
class_name LudusAgent
extends Node
## Makes a node of the game an agent.
##
## Put it under the node that has the five methods [code]apply_action(action)[/code],
## [code]get_observation()[/code], [code]get_reward()[/code], [code]is_done()[/code] and
## [code]reset()[/code] (or point [member target_path] at it); a [LudusController2D] or
## [LudusController3D] has stubs for them. Optional methods, used where they are:
## [code]get_action_mask() -> PackedByteArray[/code], one byte per alternative, 1 = allowed;
## [code]is_truncated() -> bool[/code]; and [code]get_manual_action()[/code], which lets a person
## play while no trainer is there, and returns null until something is chosen.[br][br]
## Sensors below the node, such as [LudusRays2D], are entries of the observation, beside those of
## [code]get_observation()[/code], which may then be left out.[br][br]
## An action arrives as an [int] (one choice), a [PackedInt64Array] (several choices), a
## [PackedFloat32Array] (numbers), or a dictionary of component name to [int] or
## [PackedFloat32Array] (both kinds). An observation is a flat array of numbers, or a dictionary of
## entry name to array or [Image].

## When an action is handed to the game.
enum ActionTiming {
	EVERY_TICK,  ## In every tick of the step.
	ONCE,  ## In the first tick of the step.
}

const LudusPolicyBatch := preload("res://addons/ludus/agent/policy_batch.gd")
const LudusRegistry := preload("res://addons/ludus/bridge/registry.gd")
const LudusScriptReview := preload("res://addons/ludus/agent/script_review.gd")
const LudusSensing := preload("res://addons/ludus/sensors/sensing.gd")

## The former name of [member sample_actions].
const FORMER_SAMPLE_ACTIONS := &"is_sampling"
const GROUP_NAME := &"ludus_agents"
const OBSERVE := &"get_observation"
const REQUIRED_METHODS: Array[StringName] = [
	&"apply_action", &"get_observation", &"get_reward", &"is_done", &"reset"
]

## Agents with one policy name share a network.
@export var policy_name: String = "agent":
	set(value):
		policy_name = value
		update_configuration_warnings()
## The node that has the five methods; empty: the parent.
@export var target_path: NodePath:
	set(value):
		target_path = value
		update_configuration_warnings()
## What the agent sees. Empty: taken from the first observation, as float32 without bounds.
@export var observation: Array[LudusObservationEntry] = []:
	set(value):
		observation = value
		_watch(observation)
## What the agent decides.
@export var action: Array[LudusActionComponent] = []:
	set(value):
		action = value
		_watch(action)
## Physics ticks per decision; the same for all agents of the game.
@export_range(1, 1000) var ticks_per_step: int = 2
## Whether the game gets the action in every tick of a step or only in the first.
@export var action_timing: LudusAgent.ActionTiming = ActionTiming.EVERY_TICK
## Steps after which an episode is cut off (truncated); 0: never.
@export_range(0, 1000000, 1, "or_greater") var max_episode_steps: int = 0
## Whether the game must have [code]get_action_mask()[/code]. The method is used in any case.
@export var has_action_mask: bool = false:
	set(value):
		has_action_mask = value
		update_configuration_warnings()
## An agent that is not enabled takes no part.
@export var enabled: bool = true:
	set(value):
		enabled = value
		LudusRegistry.num_changes += 1
## Training settings of the policy; null: the trainer's choice.
@export var settings: LudusPolicySettings
@export_group("Play")
## The trained policy that plays the agent while no trainer is there.
@export var policy: LudusPolicy:
	set(value):
		policy = value
		LudusRegistry.num_changes += 1
		_watch([policy])
## Whether the policy draws its actions, as in training, instead of taking the most probable ones.
@export var sample_actions: bool = false

## What has the five methods: a node, or the seat of an agent of a [LudusSimulation].
var target: Object
## What is asked for observations: [member target], unless there are sensors.
var observer: Object
## The world this agent lives in.
var world: LudusWorld
## Steps since the episode began.
var episode_steps: int:
	get:
		return _batch.episode_steps(_slot) if _batch != null else _manual_steps
	set(value):
		_manual_steps = value

var _batch: LudusPolicyBatch
var _slot: int = -1
var _manual_steps: int = 0
var _has_manual_action: bool = false


## Takes the former name of a property, from scenes that have it.
func _set(property: StringName, value: Variant) -> bool:
	if property != FORMER_SAMPLE_ACTIONS:
		return false
	sample_actions = value
	return true


func _enter_tree() -> void:
	add_to_group(GROUP_NAME)
	LudusRegistry.add(self)


func _exit_tree() -> void:
	LudusRegistry.remove(self)


## Finds target and world. Returns what is wrong with the agent, or an empty text.
func connect_to_game() -> String:
	target = _find_target()
	if target == null:
		return "target_path %s leads nowhere" % target_path
	var sensors := LudusSensing.find_sensors(self, target)
	for method: StringName in REQUIRED_METHODS:
		var is_there := LudusScriptReview.has_game_method(target, method)
		if not (is_there or (method == OBSERVE and not sensors.is_empty())):
			return "%s has no method %s()%s" % [_describe(target), method, _guess(target, method)]
	if has_action_mask and not LudusScriptReview.has_game_method(target, &"get_action_mask"):
		return "has_action_mask is on, but %s has no method get_action_mask()" % _describe(target)
	if action.is_empty():
		return "no action is declared: add a LudusActionComponent to `action`"
	has_action_mask = has_mask()
	_has_manual_action = LudusScriptReview.has_game_method(target, &"get_manual_action")
	world = LudusWorld.of(self)
	observer = target if sensors.is_empty() else LudusSensing.new(self, sensors)
	var mistake := LudusSensing.find_mistake(sensors)
	return LudusScriptReview.find_await(target.get_script()) if mistake.is_empty() else mistake


## Whether the game itself observes, by [code]get_observation()[/code].
func game_observes() -> bool:
	return _target_has(OBSERVE)


## The entries of the observation that are known before the game runs: those that are declared, and
## those of sensors.
func known_entries() -> Array[LudusObservationEntry]:
	var entries: Array[LudusObservationEntry] = observation.duplicate()
	for sensor: Node in LudusSensing.find_sensors(self, _find_target()):
		entries.append(LudusSensing.entry_of(sensor))
	return entries


## Whether actions are masked: the game has [code]get_action_mask()[/code]. Agents of a
## [LudusSimulation] are told by it.
func has_mask() -> bool:
	return has_action_mask or (_find_target() is Node and _target_has(&"get_action_mask"))


## Tells the agent which batch counts its steps.
func join_batch(batch: LudusPolicyBatch, slot: int) -> void:
	_batch = batch
	_slot = slot
	LudusRegistry.newcomers.erase(self)


## Whether a batch has the agent in a slot.
func is_in_batch() -> bool:
	return _batch != null and _batch.agents[_slot] == self


## What is probably wrong with the game, though it can be played.
func doubts() -> PackedStringArray:
	return LudusScriptReview.misspelt_methods(target.get_script())


## Whether the agent is about to leave the scene.
func is_leaving() -> bool:
	return (
		is_queued_for_deletion()
		or target.is_queued_for_deletion()
		or world.root.is_queued_for_deletion()
	)


## Whether the game has [code]is_truncated()[/code].
func has_truncation() -> bool:
	return LudusScriptReview.has_game_method(target, &"is_truncated")


## Whether the game has [code]get_manual_action()[/code].
func has_manual_action() -> bool:
	return _has_manual_action


## Path inside the world, for messages.
func path_in_world() -> String:
	var own_world := world if world != null else LudusWorld.find_above(self)
	return str(own_world.root.get_path_to(self)) if own_world != null else str(get_path())


## Looks at the warnings again whenever one of [param resources] changes, in the editor.
func _watch(resources: Array) -> void:
	if not Engine.is_editor_hint():
		return
	for resource: Resource in resources:
		if resource != null and not resource.changed.is_connected(update_configuration_warnings):
			resource.changed.connect(update_configuration_warnings)
	update_configuration_warnings()


func _find_target() -> Object:
	if has_method(REQUIRED_METHODS[0]):
		return self
	return get_parent() if target_path.is_empty() else get_node_or_null(target_path)


## Whether the target has a method; in the editor, where it does not run, by its script.
func _target_has(method: StringName) -> bool:
	var node := _find_target()
	if node == null or LudusScriptReview.has_game_method(node, method):
		return node != null
	return node.get_script() != null and method in LudusScriptReview.methods_of(node.get_script())


## A method that is probably [param method] misspelt, in words.
static func _guess(node: Object, method: StringName) -> String:
	var script: Script = node.get_script()
	if script == null:
		return ""
	var found := LudusScriptReview.find_misspelt(script, method, true)
	return "" if found.is_empty() else "; did you misspell it as %s()?" % found


func _describe(node: Object) -> String:
	var script: Script = node.get_script()
	return "%s (%s)" % [node.name, script.resource_path if script != null else node.get_class()]


func _get_configuration_warnings() -> PackedStringArray:
	var warnings := PackedStringArray()
	if policy_name.is_empty():
		warnings.append("policy_name is empty.")
	if action.is_empty():
		warnings.append("No action is declared: add a LudusActionComponent to `action`.")
	if action.has(null) or observation.has(null):
		warnings.append("`action` or `observation` has an empty item.")
	for component: LudusActionComponent in action:
		if component != null and not component.is_valid():
			warnings.append("Action %s: low must be below high, n at least 1." % component.name)
	var problem := policy.incompatibility(self) if policy != null else ""
	if not problem.is_empty():
		warnings.append("The policy does not fit: %s." % problem)
	var node := _find_target()
	if node == null:
		warnings.append("target_path leads nowhere.")
	elif node != self and node.get_script() == null:
		warnings.append("%s has no script with the five methods." % node.name)
	elif node.get_script() != null:
		warnings.append_array(_method_warnings(node.get_script()))
	return warnings


func _method_warnings(script: Script) -> PackedStringArray:
	var names := LudusScriptReview.methods_of(script)
	var warnings := LudusScriptReview.misspelt_methods(script)
	var wait := LudusScriptReview.find_await(script)
	if not wait.is_empty():
		warnings.append(wait)
	var sensors := LudusSensing.find_sensors(self, _find_target())
	var mistake := LudusSensing.find_mistake(sensors)
	if not mistake.is_empty():
		warnings.append(mistake + ".")
	for method: StringName in REQUIRED_METHODS:
		if method not in names and (method != OBSERVE or sensors.is_empty()):
			warnings.append("The target has no method %s()." % method)
	if has_action_mask and &"get_action_mask" not in names:
		warnings.append("has_action_mask is on, but the target has no method get_action_mask().")
	return warnings
