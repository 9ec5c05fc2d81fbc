@tool
@icon("res://addons/ludus/icons/ludus_training.svg")
class_name LudusTraining
extends Node
## Lets the game guide its own training: press Play, and it trains.
##
## Put it into the scene that is to be trained, or into another scene that names it
## ([member scene_path]). When the game runs, it looks for [code]ludus serve[/code] at
## [member port], starts it if need be, and asks it to train, to stop, to play a round for people
## to watch, to save and to write the policies. Keys, an overlay and the methods here do the same.
## In the worlds that are trained, in games that a trainer has started, and in release builds
## without the custom feature [code]ludus[/code], the node does nothing.

## Emitted when the trainer has come, gone, or begun something else.
signal state_changed(state: LudusTraining.State)
## Emitted with all that the trainer tells, after every update and a few times a second (PROTOCOL.md
## §8).
signal status_changed(status: Dictionary)

## What goes on.
enum State {
	OFFLINE,  ## There is no trainer.
	CONNECTING,  ## One is looked for, or starts.
	GREETING,  ## One was found that has told nothing yet.
	STANDBY,  ## There is one, and it waits.
	TRAINING,  ## Policies learn.
	PLAYING,  ## A round is played for people to watch; nothing learns.
}

const LudusGuidedTraining := preload("res://addons/ludus/training/guided_training.gd")
const LudusRegistry := preload("res://addons/ludus/bridge/registry.gd")
const LudusStage := preload("res://addons/ludus/world/stage.gd")
const LudusTrainingKeys := preload("res://addons/ludus/training/training_keys.gd")
const LudusTrainingOverlay := preload("res://addons/ludus/training/training_overlay.gd")
const LudusWire := preload("res://addons/ludus/bridge/wire.gd")

const NO_AUTOLOAD := "the autoload Ludus is missing; enable the plugin Ludus"
## Properties under their former names, which scenes may have.
const FORMER_NAMES: Dictionary[StringName, StringName] = {
	&"num_drawn": &"visible_worlds",
	&"starts_by_itself": &"autostart",
	&"has_keys": &"shortcuts_enabled",
}

## Name of the run, a folder in [member runs_folder]. A run that is there goes on; empty: the name
## of the scene.
@export var run_name: String = ""
## Worlds that are trained side by side.
@export_range(1, 4096) var num_worlds: int = 16
## How many of them are drawn.
@export_range(0, 16) var visible_worlds: int = 1
## A checkpoint that is kept for ever after every so many updates; 0: none.
@export_range(0, 100000) var checkpoint_every_updates: int = 1000
## Whether to look for a trainer, and train, as soon as the game runs.
@export var autostart: bool = true
## Scene to train; empty: the one that is played. A scene named here is trained inside the one that
## is played, which stays.
@export_file("*.tscn") var scene_path: String = ""
@export_group("Interface")
## Whether an overlay tells how it goes.
@export var has_overlay: bool = true
## Whether keys guide the training.
@export var shortcuts_enabled: bool = true
## The key of each action. An action without one has that of the project's input map, or else the
## usual one: Shift with F1 to F10, in this order.
@export var keys: Dictionary[StringName, InputEventKey] = {
	&"ludus_overlay": null,
	&"ludus_play_round": null,
	&"ludus_start": null,
	&"ludus_stop": null,
	&"ludus_connect": null,
	&"ludus_write_policies": null,
	&"ludus_train_first": null,
	&"ludus_train_second": null,
	&"ludus_train_all": null,
	&"ludus_train_none": null,
}
@export_group("Server")
## Where runs lie. Empty: [code]res://runs[/code] in the editor, [code]user://runs[/code] in an
## exported game.
@export_dir var runs_folder: String = ""
## Where [method write_policies] puts the trained policies. Empty: [code]res://policies[/code] or
## [code]user://policies[/code].
@export_dir var policies_folder: String = ""
## TCP port of [code]ludus serve[/code] on this machine.
@export_range(1, 65535) var port: int = LudusWire.DEFAULT_PORT

## What goes on.
var state: LudusTraining.State:
	get:
		return State.OFFLINE if _guided == null else _guided.state
## What the trainer told last.
var status: Dictionary:
	get:
		return {} if _guided == null else _guided.status
## What was done last, or went wrong, for people to read.
var message: String:
	get:
		return NO_AUTOLOAD if _guided == null else _guided.message
## Why the last trainer went away; an empty text if none did.
var disconnect_reason: String:
	get:
		return "" if _guided == null else _guided.disconnect_reason
## Mode of each policy, by name.
var modes: Dictionary[String, LudusBridge.PolicyMode]:
	get:
		return {} if _guided == null else _guided.requests.modes

## The owner of what goes on; null without the autoload.
var _guided: LudusGuidedTraining:
	get:
		return LudusRegistry.bridge.guided if LudusRegistry.bridge != null else null


## Whether this node guides; false in the worlds that are trained.
func is_in_charge() -> bool:
	var ancestor := get_parent()
	while ancestor != null:
		if ancestor is LudusStage:
			return false
		ancestor = ancestor.get_parent()
	return (
		not Engine.is_editor_hint()
		and LudusBridge.is_trainable()
		and not LudusBridge.has_trainer_arguments()
	)


## Looks for a trainer, and starts one if there is none.
func connect_trainer() -> void:
	if _guided != null and LudusBridge.is_trainable():
		_guided.connect_trainer(self)


## Trains until [method stop]. Returns false if no trainer listens.
func start() -> bool:
	return _guided != null and _told(_guided.requests.add_guided("start"))


## Ends training, with a checkpoint, or the round that is played. Returns false if no trainer
## listens.
func stop() -> bool:
	return _guided != null and _told(_guided.requests.add({"kind": "stop"}))


## Plays one round with the most probable actions of all policies, at a speed for people. Returns
## false if no trainer listens.
func play_round() -> bool:
	return _guided != null and _told(_guided.requests.add_guided("play_round"))


## Writes all policies for use in the game, see [LudusPolicy]. Returns false if no trainer listens.
func write_policies() -> bool:
	return _guided != null and _told(_guided.requests.add_guided("write_policies"))


## Puts a policy into another mode; as [code]Ludus.set_policy_mode()[/code] does.
func set_policy_mode(policy: String, mode: LudusBridge.PolicyMode) -> bool:
	return _guided != null and _told(_guided.requests.set_mode(policy, mode))


## Lets only [param policies] learn; all others play their most probable actions.
func train_only(policies: PackedStringArray) -> void:
	for policy: String in modes:
		var is_learning := policy in policies
		var mode := LudusBridge.PolicyMode.DETERMINISTIC
		set_policy_mode(policy, LudusBridge.PolicyMode.TRAIN if is_learning else mode)


## What the trainer is told in the greeting (PROTOCOL.md §3).
func to_json() -> Dictionary:
	var settings := {"run": _run_name(), "num_worlds": num_worlds}
	if checkpoint_every_updates > 0:
		settings["checkpoint_every_updates"] = checkpoint_every_updates
	return settings


func _ready() -> void:
	if Engine.is_editor_hint():
		return
	process_mode = Node.PROCESS_MODE_ALWAYS
	if not is_in_charge() or state != State.OFFLINE:
		return
	if has_overlay and DisplayServer.get_name() != "headless":
		add_child(LudusTrainingOverlay.new(self))
	if shortcuts_enabled:
		add_child(LudusTrainingKeys.new(self))
	if _guided == null:
		printerr("ludus: ", NO_AUTOLOAD)
		return
	_guided.state_changed.connect(state_changed.emit)
	_guided.status_changed.connect(status_changed.emit)
	if autostart and not _guided.has_been_online:
		_guided.connect_trainer(self, true)


## Takes former names of properties, from scenes that have them.
func _set(property: StringName, value: Variant) -> bool:
	if FORMER_NAMES.has(property):
		set(FORMER_NAMES[property], value)
	return FORMER_NAMES.has(property)


## Shows why a request was refused, if it was. Returns whether it was not.
func _told(is_accepted: bool) -> bool:
	if not is_accepted:
		_guided.message = _guided.requests.last_refusal
	return is_accepted


func _run_name() -> String:
	if not run_name.is_empty():
		return run_name
	var path := scene_path
	if path.is_empty() and get_tree().current_scene != null:
		path = get_tree().current_scene.scene_file_path
	var others := RegEx.create_from_string("[^A-Za-z0-9_-]")
	return others.sub(path.get_file().get_basename(), "_", true)
