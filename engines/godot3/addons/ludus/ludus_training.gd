class_name LudusTraining, "res://addons/ludus/icons/ludus_training.svg"
extends Node
## Lets the game guide its own training: press Play, and it trains.
##
## Put it into the scene that is to be trained, or into another scene that names it
## ([member scene_path]). When the game runs, it looks for [code]ludus serve[/code] at
## [member port], starts it if need be, and asks it to train, to stop, to play a round for people
## to watch, to save and to write the policies. Keys, an overlay and the methods here do the same.
## In the worlds that are trained, and in games that a trainer has started, the node does nothing.

## Emitted when the trainer has come, gone, or begun something else; [param state] is one of
## [enum State].
signal state_changed(state)
## Emitted with all that the trainer tells, a few times a second (PROTOCOL.md §8).
signal status_changed(status)

## What goes on: there is no trainer; one is looked for, or starts; there is one, and it waits;
## policies learn; a round is played for people to watch, and nothing learns.
enum State { OFFLINE, CONNECTING, STANDBY, TRAINING, PLAYING }

const START_TIMEOUT_MS := 60000
const RETRY_MS := 250
const CONNECT_TIMEOUT_MS := 100
const FAREWELL := "farewell"
const HAS_BEEN_ONLINE := "has_been_online"
## Why the last trainer went away. A trainer that came and went is not called again unasked. Godot 3
## has no static variables; what a constant dictionary holds is shared all the same.
const _SHARED := {FAREWELL: "", HAS_BEEN_ONLINE: false}

## Name of the run, a folder in [member runs_folder]. A run that is there goes on; empty: the name
## of the scene.
export var run_name: String = ""
## Worlds that are trained side by side.
export(int, 1, 4096) var num_worlds: int = 16
## How many of them are drawn.
export(int, 0, 16) var num_drawn: int = 1
## A checkpoint that is kept for ever after every so many updates; 0: none.
export(int, 0, 100000) var checkpoint_every_updates: int = 1000
## Whether to look for a trainer, and train, as soon as the game runs.
export var starts_by_itself: bool = true
## Scene to train; empty: the one that is played. A scene named here is trained inside the one that
## is played, which stays.
export(String, FILE, "*.tscn") var scene_path: String = ""
## Whether an overlay tells how it goes.
export var has_overlay: bool = true
## Whether keys guide the training; see [LudusTrainingKeys].
export var has_keys: bool = true
## Where runs lie. Empty: [code]res://runs[/code] in the editor, [code]user://runs[/code] in an
## exported game.
export(String, DIR) var runs_folder: String = ""
## Where [method write_policies] puts the trained policies. Empty: [code]res://policies[/code] or
## [code]user://policies[/code].
export(String, DIR) var policies_folder: String = ""
## TCP port of [code]ludus serve[/code] on this machine.
export(int, 1, 65535) var port: int = LudusWire.DEFAULT_PORT

## What goes on, one of [enum State].
var state: int = State.OFFLINE
## What the trainer told last.
var status: Dictionary = {}
## What was done last, or went wrong, for people to read.
var message: String = ""
## Mode of each policy ([enum LudusBridge.PolicyMode]), by name.
var modes: Dictionary = {}

var _server: LudusTrainerProcess
var _is_start_due: bool = false
var _deadline_ms: int = 0
var _retry_ms: int = 0


## Why the last trainer went away; an empty text if none did.
static func farewell() -> String:
	return _SHARED[FAREWELL]


## Whether this node guides; false in the worlds that are trained.
func is_in_charge() -> bool:
	var ancestor := get_parent()
	while ancestor != null:
		if ancestor is LudusStage:
			return false
		ancestor = ancestor.get_parent()
	return not Engine.editor_hint and not LudusBridge.has_trainer_arguments()


## Looks for a trainer, and starts one if there is none.
func connect_trainer() -> void:
	if state != State.OFFLINE:
		return
	message = "looking for a trainer"
	_server = null
	_deadline_ms = OS.get_ticks_msec() + START_TIMEOUT_MS
	_retry_ms = 0
	_enter(State.CONNECTING)


## Trains until [method stop]. Returns false if no trainer listens.
func start() -> bool:
	return _ask("start_training")


## Ends training, with a checkpoint, or the round that is played. Returns false if no trainer
## listens.
func stop() -> bool:
	return _ask("stop_training")


## Plays one round with the most probable actions of all policies, at a speed for people. Returns
## false if no trainer listens.
func play_round() -> bool:
	return _ask("play_round")


## Writes all policies for use in the game, see [LudusPolicy]. Returns false if no trainer listens.
func write_policies() -> bool:
	return _ask("write_policies")


## Puts a policy into another mode; see [method LudusBridge.set_policy_mode].
func set_policy_mode(policy: String, mode: int) -> bool:
	return _ask("set_policy_mode", [policy, mode])


## Lets only [param policies] learn; all others play their most probable actions.
func train_only(policies: Array) -> void:
	for policy in modes:
		var mode: int = LudusBridge.PolicyMode.DETERMINISTIC
		if policy in policies:
			mode = LudusBridge.PolicyMode.TRAIN
		var _is_asked := set_policy_mode(policy, mode)


## What the trainer is told in the greeting (PROTOCOL.md §3).
func to_json() -> Dictionary:
	var settings := {"run": _run_name(), "num_worlds": num_worlds}
	if checkpoint_every_updates > 0:
		settings["checkpoint_every_updates"] = checkpoint_every_updates
	return settings


## Takes in what the trainer tells.
func take_in(told: Dictionary) -> void:
	status = told
	var words = told.get("message")
	if words is String and not words.empty():
		message = words
	_note_modes(told.get("policies"))
	match told.get("state"):
		"standby":
			_stand_by()
		"training":
			_enter(State.TRAINING)
		"playing":
			_enter(State.PLAYING)
	emit_signal("status_changed", told)


## Notes that the trainer has gone.
func take_leave(reason: String) -> void:
	_SHARED[FAREWELL] = reason
	message = reason
	_enter(State.OFFLINE)


func _enter_tree() -> void:
	add_to_group(LudusGuidance.TRAINING_GROUP_NAME)


func _ready() -> void:
	pause_mode = Node.PAUSE_MODE_PROCESS
	if not is_in_charge() or state != State.OFFLINE:
		set_process(false)
		return
	if has_overlay and not OS.has_feature("Server"):
		add_child(LudusTrainingOverlay.new(self))
	if has_keys:
		add_child(LudusTrainingKeys.new(self))
	message = farewell()
	if starts_by_itself and not _SHARED[HAS_BEEN_ONLINE]:
		_is_start_due = true
		connect_trainer()


func _process(_delta: float) -> void:
	if state != State.CONNECTING or OS.get_ticks_msec() < _retry_ms:
		return
	_retry_ms = OS.get_ticks_msec() + RETRY_MS
	var link := LudusLink.new()
	if link.connect_to(["tcp:127.0.0.1:%d" % port], CONNECT_TIMEOUT_MS):
		_SHARED[HAS_BEEN_ONLINE] = true
		_SHARED[FAREWELL] = ""
		message = ""
		LudusBridge.guide(self, link)
	elif _server == null:
		_start_trainer()
	elif _server.has_ended():
		_give_up(_server.describe_end())
	elif OS.get_ticks_msec() > _deadline_ms:
		_give_up("no trainer answers at port %d" % port)


func _start_trainer() -> void:
	message = "starting ludus serve"
	_server = LudusTrainerProcess.new()
	if not _server.start(port, _folder(runs_folder, "runs"), _folder(policies_folder, "policies")):
		_give_up(_server.error)


func _give_up(reason: String) -> void:
	printerr("ludus: ", reason)
	take_leave(reason)


func _ask(method: String, arguments: Array = []) -> bool:
	var complaint := LudusBridge.ask(method, arguments)
	if not complaint.empty():
		message = complaint
	return complaint.empty()


func _note_modes(policies) -> void:
	if not policies is Dictionary:
		return
	for policy in policies:
		var word = policies[policy].get("mode") if policies[policy] is Dictionary else null
		var mode: int = LudusRequests.MODES.find(word) if word is String else -1
		if mode >= 0:
			modes[policy] = mode


func _stand_by() -> void:
	_enter(State.STANDBY)
	if _is_start_due:
		_is_start_due = false
		var _is_asked := start()


func _enter(next: int) -> void:
	if next != state:
		state = next
		emit_signal("state_changed", state)


func _run_name() -> String:
	if not run_name.empty():
		return run_name
	var path := scene_path
	if path.empty() and get_tree().current_scene != null:
		path = get_tree().current_scene.filename
	var others := RegEx.new()
	if others.compile("[^A-Za-z0-9_-]") != OK:
		push_error("ludus: not a pattern")
	return others.sub(path.get_file().get_basename(), "_", true)


static func _folder(chosen: String, usual: String) -> String:
	if not chosen.empty():
		return ProjectSettings.globalize_path(chosen)
	var root := "res://" if OS.has_feature("editor") else "user://"
	return ProjectSettings.globalize_path(root + usual)
