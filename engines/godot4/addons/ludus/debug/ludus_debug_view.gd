@icon("res://addons/ludus/icons/ludus_debug_view.svg")
class_name LudusDebugView
extends CanvasLayer
## Shows what an agent sees, what it decides and what it gets for that, over the running game.
##
## The autoload "Ludus" brings one along in a game that can be trained, so that F4 shows it wherever
## a trainer, a [LudusPolicy] or a person plays. Put one into a scene for other keys, or to have it
## in an exported game. It costs nothing as long as it is hidden.

const LudusCameras := preload("res://addons/ludus/cameras/cameras.gd")
const LudusDebugPanel := preload("res://addons/ludus/debug/debug_panel.gd")
const LudusGame := preload("res://addons/ludus/world/game.gd")
const LudusPolicyBatch := preload("res://addons/ludus/agent/policy_batch.gd")
const LudusPolicyGroup := preload("res://addons/ludus/policy/policy_group.gd")
const LudusRegistry := preload("res://addons/ludus/bridge/registry.gd")
const LudusSensing := preload("res://addons/ludus/sensors/sensing.gd")
const LudusTrainingKeys := preload("res://addons/ludus/training/training_keys.gd")
const LudusWatchedAgent := preload("res://addons/ludus/debug/watched_agent.gd")
const LudusWire := preload("res://addons/ludus/bridge/wire.gd")

## Keys of actions that neither the node nor the project's input map gives another.
const USUAL_KEYS: Dictionary[StringName, Key] = {
	&"ludus_debug_view": KEY_F4,
	&"ludus_previous_agent": KEY_F5,
	&"ludus_next_agent": KEY_F6,
}
const TOP := 32.0

## Other keys than the usual ones, by action: [code]ludus_debug_view[/code] shows and hides the
## view, [code]ludus_previous_agent[/code] and [code]ludus_next_agent[/code] choose the agent. An
## input action of that name in the project's input map does the same.
@export var keys: Dictionary[StringName, InputEventKey] = {}

## The agent that is shown.
var watched := LudusWatchedAgent.new()

var _panel: LudusDebugPanel
var _replaced: LudusDebugView
## Sensors that draw themselves because their agent is shown.
var _drawn: Array[Node] = []
var _drawn_of: LudusAgent
## Where the agents are: in a game that is stepped by a trainer, or with policies of their own.
var _batches: Array[LudusPolicyBatch] = []


func _init() -> void:
	layer = 126
	visible = false
	process_mode = Node.PROCESS_MODE_ALWAYS


func _enter_tree() -> void:
	_replaced = LudusRegistry.debug_view
	if _replaced != null:
		_replaced.hide_view()
	LudusRegistry.debug_view = self
	LudusTrainingKeys.add_actions(keys, USUAL_KEYS, false)


func _exit_tree() -> void:
	hide_view()
	if LudusRegistry.debug_view == self:
		LudusRegistry.debug_view = _replaced if is_instance_valid(_replaced) else null


func _input(event: InputEvent) -> void:
	if LudusRegistry.debug_view != self or event is not InputEventKey:
		return
	if event.is_action_pressed(&"ludus_debug_view", false, true):
		if visible:
			hide_view()
		else:
			show_view()
	elif visible and event.is_action_pressed(&"ludus_previous_agent", false, true):
		choose(-1)
	elif visible and event.is_action_pressed(&"ludus_next_agent", false, true):
		choose(1)
	else:
		return
	get_viewport().set_input_as_handled()


## Shows the view.
func show_view() -> void:
	if _panel == null:
		_panel = LudusDebugPanel.new()
		_panel.position = Vector2(8.0, TOP)
		_panel.watched = watched
		add_child(_panel)
	_panel.help = _describe_keys()
	visible = true
	_refresh()


## Hides the view, and forgets all that it knew.
func hide_view() -> void:
	visible = false
	_draw_sensors(null)
	_batches = []
	_watch(null, 0)


## Shows the agent [param distance] places further on, counted over all policies and worlds.
func choose(distance: int) -> void:
	var places: Array[Vector2i] = []
	var now := 0
	for i: int in _batches.size():
		for slot: int in _batches[i].agents.size():
			if _batches[i].agents[slot] == null:
				continue
			if _batches[i] == watched.batch and slot == watched.slot:
				now = places.size()
			places.append(Vector2i(i, slot))
	if places.is_empty():
		return
	var next := places[posmod(now + distance, places.size())]
	_watch(_batches[next.x], next.y)
	_refresh()


## Takes the frame [code]BATCH[/code] that a trainer is sent; [param is_reset] if that answers a
## [code]RESET[/code].
func take_batch(game: LudusGame, frame: PackedByteArray, is_reset: bool) -> void:
	_follow(game.policies)
	var offset := LudusWire.HEADER_BYTES + LudusWire.BATCH_HEAD_BYTES
	for policy: LudusPolicyBatch in game.policies:
		if policy == watched.batch:
			watched.read_batch(frame, offset, is_reset)
		offset += LudusWatchedAgent.count_batch_bytes(policy)
	_refresh()


## Takes the payload of a [code]STEP[/code] of a trainer.
func take_actions(game: LudusGame, payload: PackedByteArray) -> void:
	_follow(game.policies)
	var offset := 0
	for policy: LudusPolicyBatch in game.policies:
		if policy == watched.batch:
			watched.read_actions(payload, offset)
		offset += policy.action_bytes()
	_refresh()


## Takes what a trainer tells of the decision of the agent that it was asked for.
func take_decision(told: Dictionary) -> void:
	if watched.batch == null or told.get("policy") != watched.batch.policy_name:
		return
	if told.get("slot") == watched.slot:
		watched.take_decision(told)


## Says which agents have policies of their own.
func follow_groups(groups: Array[LudusPolicyGroup]) -> void:
	var batches: Array[LudusPolicyBatch] = []
	for group: LudusPolicyGroup in groups:
		batches.append(group.batch)
	if not batches.is_empty() or watched.batch != null:
		_follow(batches)


## Takes what a policy in the game has decided in this tick, if its agent is shown.
func take_group(group: LudusPolicyGroup) -> void:
	if group.batch == watched.batch:
		watched.read_group(group)
		_refresh()


## Takes what a person has decided for an agent; the first of those that people play is shown.
func take_person(agent: LudusAgent, action: Variant, reward: Variant) -> void:
	if watched.agent() == null:
		watched.watch_person(agent)
	if watched.batch == null and watched.agent() == agent:
		watched.read_person(action, reward, agent.episode_steps <= 1)
		_refresh()


func _follow(batches: Array[LudusPolicyBatch]) -> void:
	_batches = batches
	if watched.batch not in batches or watched.agent() == null:
		_watch(null, 0)
		choose(0)


func _watch(batch: LudusPolicyBatch, slot: int) -> void:
	watched.watch(batch, slot)
	if LudusRegistry.bridge != null:
		LudusRegistry.bridge.watch_agent(batch.policy_name if batch != null else "", slot)


func _refresh() -> void:
	var agent := watched.agent()
	if agent == null or not agent.is_inside_tree():
		_panel.title = "nobody plays an agent"
		_draw_sensors(null)
	else:
		var place := [agent.policy_name, agent.world.index, agent.path_in_world()]
		_panel.title = "%s  world %d  %s" % place + "  step %d" % agent.episode_steps
		_draw_sensors(agent)
	_panel.queue_redraw()


## Lets the sensors of the agent draw themselves, and no others. Cameras would see that, so where
## there are any, nothing draws itself.
func _draw_sensors(agent: LudusAgent) -> void:
	if agent == _drawn_of:
		return
	for sensor: Variant in _drawn:
		if is_instance_valid(sensor):
			(sensor as Node).call(&"draw_in_game", false)
	_drawn.clear()
	_drawn_of = agent
	if agent == null or LudusCameras.are_used():
		return
	_drawn = LudusSensing.find_all_sensors(agent)
	for sensor: Node in _drawn:
		sensor.call(&"draw_in_game", true)


static func _describe_keys() -> String:
	var parts: PackedStringArray = []
	for action: StringName in USUAL_KEYS:
		parts.append(LudusTrainingKeys.describe(action))
	return "%s hides, %s and %s choose the agent" % Array(parts)
