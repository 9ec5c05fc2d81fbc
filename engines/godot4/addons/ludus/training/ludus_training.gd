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
signal state_changed(state: State)
## Emitted with all that the trainer tells, after every update and a few times a second (PROTOCOL.md
## §8).
signal status_changed(status: Dictionary)

## What goes on.
enum State {
	OFFLINE,  ## There is no trainer.
	CONNECTING,  ## One is looked for, or starts.
	STANDBY,  ## There is one, and it waits.
	TRAINING,  ## Policies learn.
	PLAYING,  ## A round is played for people to watch; nothing learns.
}

const LudusLink := preload("res://addons/ludus/bridge/link.gd")
const LudusRequests := preload("res://addons/ludus/bridge/requests.gd")
const LudusStage := preload("res://addons/ludus/world/stage.gd")
const LudusTrainerProcess := preload("res://addons/ludus/training/trainer_process.gd")
const LudusTrainingKeys := preload("res://addons/ludus/training/training_keys.gd")
const LudusTrainingOverlay := preload("res://addons/ludus/training/training_overlay.gd")
const LudusWire := preload("res://addons/ludus/bridge/wire.gd")

const START_TIMEOUT_MS := 60000
const RETRY_MS := 250
const CONNECT_TIMEOUT_MS := 100

## Why the last trainer went away; an empty text if none did. A trainer that came and went is not
## called again unasked.
static var farewell: String = ""
static var _has_been_online: bool = false

## Name of the run, a folder in [member runs_folder]. A run that is there goes on; empty: the name
## of the scene.
@export var run_name: String = ""
## Worlds that are trained side by side.
@export_range(1, 4096) var num_worlds: int = 16
## How many of them are drawn.
@export_range(0, 16) var num_drawn: int = 1
## A checkpoint that is kept for ever after every so many updates; 0: none.
@export_range(0, 100000) var checkpoint_every_updates: int = 1000
## Whether to look for a trainer, and train, as soon as the game runs.
@export var starts_by_itself: bool = true
## Scene to train; empty: the one that is played. A scene named here is trained inside the one that
## is played, which stays.
@export_file("*.tscn") var scene_path: String = ""
@export_group("Interface")
## Whether an overlay tells how it goes.
@export var has_overlay: bool = true
## Whether keys guide the training.
@export var has_keys: bool = true
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
var state: State = State.OFFLINE
## What the trainer told last.
var status: Dictionary = {}
## What was done last, or went wrong, for people to read.
var message: String = ""
## Mode of each policy, by name.
var modes: Dictionary[String, LudusBridge.PolicyMode] = {}

var _server: LudusTrainerProcess
## Whether a trainer was found that has told nothing yet; a second connection would be refused.
var _is_greeting: bool = false
var _is_start_due: bool = false
var _deadline_ms: int = 0
var _retry_ms: int = 0


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
	if state != State.OFFLINE or not LudusBridge.is_trainable():
		return
	message = "looking for a trainer"
	_server = null
	_deadline_ms = Time.get_ticks_msec() + START_TIMEOUT_MS
	_retry_ms = 0
	_enter(State.CONNECTING)


## Trains until [method stop]. Returns false if no trainer listens.
func start() -> bool:
	return _ask(&"start_training")


## Ends training, with a checkpoint, or the round that is played. Returns false if no trainer
## listens.
func stop() -> bool:
	return _ask(&"stop_training")


## Plays one round with the most probable actions of all policies, at a speed for people. Returns
## false if no trainer listens.
func play_round() -> bool:
	return _ask(&"play_round")


## Writes all policies for use in the game, see [LudusPolicy]. Returns false if no trainer listens.
func write_policies() -> bool:
	return _ask(&"write_policies")


## Puts a policy into another mode; see [method LudusBridge.set_policy_mode].
func set_policy_mode(policy: String, mode: LudusBridge.PolicyMode) -> bool:
	return _ask(&"set_policy_mode", [policy, mode])


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


## Takes in what the trainer tells.
func take_in(told: Dictionary) -> void:
	status = told
	var words: Variant = told.get("message")
	if words is String and not (words as String).is_empty():
		message = words
	_note_modes(told.get("policies"))
	match told.get("state"):
		"standby":
			_stand_by()
		"training":
			_enter(State.TRAINING)
		"playing":
			_enter(State.PLAYING)
	status_changed.emit(told)


## Notes that the trainer has gone.
func take_leave(reason: String) -> void:
	farewell = reason
	message = reason
	_enter(State.OFFLINE)


func _ready() -> void:
	process_mode = Node.PROCESS_MODE_ALWAYS
	if not is_in_charge() or state != State.OFFLINE:
		set_process(false)
		return
	if has_overlay and DisplayServer.get_name() != "headless":
		add_child(LudusTrainingOverlay.new(self))
	if has_keys:
		add_child(LudusTrainingKeys.new(self))
	message = farewell
	if starts_by_itself and not _has_been_online:
		_is_start_due = true
		connect_trainer()


func _process(_delta: float) -> void:
	if state != State.CONNECTING or _is_greeting or Time.get_ticks_msec() < _retry_ms:
		return
	_retry_ms = Time.get_ticks_msec() + RETRY_MS
	var link := LudusLink.new()
	if link.connect_to(["tcp:127.0.0.1:%d" % port], CONNECT_TIMEOUT_MS):
		_has_been_online = true
		_is_greeting = true
		farewell = ""
		message = ""
		LudusBridge.guide(self, link)
	elif _server == null:
		_start_trainer()
	elif _server.has_ended():
		_give_up(_server.describe_end())
	elif Time.get_ticks_msec() > _deadline_ms:
		_give_up("no trainer answers at port %d" % port)


func _start_trainer() -> void:
	message = "starting ludus serve"
	_server = LudusTrainerProcess.new()
	if not _server.start(port, _folder(runs_folder, "runs"), _folder(policies_folder, "policies")):
		_give_up(_server.error)


func _give_up(reason: String) -> void:
	printerr("ludus: ", reason)
	take_leave(reason)


func _ask(method: StringName, arguments: Array = []) -> bool:
	var complaint := LudusBridge.ask(method, arguments)
	if not complaint.is_empty():
		message = complaint
	return complaint.is_empty()


func _note_modes(policies: Variant) -> void:
	if policies is not Dictionary:
		return
	for policy: String in policies:
		var word: Variant = policies[policy].get("mode") if policies[policy] is Dictionary else null
		var mode := LudusRequests.MODES.find(word) if word is String else -1
		if mode >= 0:
			modes[policy] = mode as LudusBridge.PolicyMode


func _stand_by() -> void:
	_enter(State.STANDBY)
	if _is_start_due:
		_is_start_due = false
		start()


func _enter(next: State) -> void:
	_is_greeting = false
	if next != state:
		state = next
		state_changed.emit(state)


func _run_name() -> String:
	if not run_name.is_empty():
		return run_name
	var path := scene_path
	if path.is_empty() and get_tree().current_scene != null:
		path = get_tree().current_scene.scene_file_path
	var others := RegEx.create_from_string("[^A-Za-z0-9_-]")
	return others.sub(path.get_file().get_basename(), "_", true)


static func _folder(chosen: String, usual: String) -> String:
	if not chosen.is_empty():
		return ProjectSettings.globalize_path(chosen)
	var root := "res://" if OS.has_feature("editor") else "user://"
	return ProjectSettings.globalize_path(root + usual)
