extends Node
## The one owner of training that the game guides (PROTOCOL.md §8): it finds or starts the trainer,
## knows what goes on, and says what is different for the bridge meanwhile. The autoload has one;
## [LudusTraining] has the settings, and hands on what people ask for.

## A trainer was found, which the bridge greets.
signal trainer_found(link: LudusLink)
## The trainer has come, gone, or begun something else.
signal state_changed(state: LudusTraining.State)
## The trainer has told how it goes.
signal status_changed(status: Dictionary)

## What happens to guided training.
enum Event {
	SEARCH,  ## Somebody wants a trainer.
	FIND,  ## One listens.
	STAND_BY,  ## It waits.
	TRAIN,  ## It trains.
	PLAY,  ## It plays a round.
	LOSE,  ## It has gone, or none was found.
}

const LudusGamePace := preload("res://addons/ludus/training/game_pace.gd")
## This script: a type without it is first the game's global class of that name.
const LudusGuidedTraining := preload("res://addons/ludus/training/guided_training.gd")
const LudusLink := preload("res://addons/ludus/bridge/link.gd")
const LudusRequests := preload("res://addons/ludus/bridge/requests.gd")
const LudusStage := preload("res://addons/ludus/world/stage.gd")
const LudusTrainerProcess := preload("res://addons/ludus/training/trainer_process.gd")

const START_TIMEOUT_MS := 60000
const RETRY_MS := 250
const CONNECT_TIMEOUT_MS := 100
## The state after each event. An event that a state lacks changes nothing.
const NEXT_STATES: Dictionary[LudusTraining.State, Dictionary] = {
	LudusTraining.State.OFFLINE: {Event.SEARCH: LudusTraining.State.CONNECTING},
	LudusTraining.State.CONNECTING:
	{
		Event.FIND: LudusTraining.State.GREETING,
		Event.LOSE: LudusTraining.State.OFFLINE,
	},
	LudusTraining.State.GREETING: _ONLINE,
	LudusTraining.State.STANDBY: _ONLINE,
	LudusTraining.State.TRAINING: _ONLINE,
	LudusTraining.State.PLAYING: _ONLINE,
}
const _ONLINE := {
	Event.STAND_BY: LudusTraining.State.STANDBY,
	Event.TRAIN: LudusTraining.State.TRAINING,
	Event.PLAY: LudusTraining.State.PLAYING,
	Event.LOSE: LudusTraining.State.OFFLINE,
}
## The event of each word that the trainer has for what it does.
const EVENTS: Dictionary[String, LudusGuidedTraining.Event] = {
	"standby": Event.STAND_BY, "training": Event.TRAIN, "playing": Event.PLAY
}

## What the game asks for, and the modes of the policies.
var requests: LudusRequests
## What goes on.
var state: LudusTraining.State = LudusTraining.State.OFFLINE
## What the trainer told last.
var status: Dictionary = {}
## What was done last, or went wrong, for people to read.
var message: String = ""
## Why the last trainer went away; empty if none did.
var disconnect_reason: String = ""
## Whether there has been a trainer. One that came and went is not called again unasked.
var has_been_online: bool = false
## Whether the trainer lets the game go on by itself.
var is_standing_by: bool = false

## The node with the settings, as long as it guides or looks for a trainer.
var _settings: LudusTraining
var _pace := LudusGamePace.new()
## Frame in which the trainer had nothing to say.
var _silent_frame: int = -1
var _server: LudusTrainerProcess
## Whether to train as soon as the trainer stands by.
var _is_start_due: bool = false
var _deadline_ms: int = 0
var _retry_ms: int = 0


func _init(own_requests: LudusRequests) -> void:
	name = "GuidedTraining"
	process_mode = Node.PROCESS_MODE_ALWAYS
	requests = own_requests
	add_child(_pace)


func _ready() -> void:
	set_process(state == LudusTraining.State.CONNECTING)


## Whether the game guides the trainer at the other end.
func is_guiding() -> bool:
	return state > LudusTraining.State.CONNECTING


## Whether the current scene brings a node that looks for a trainer itself.
func is_in_scene() -> bool:
	var scene := get_tree().current_scene
	if scene == null or scene is LudusTraining:
		return scene != null
	return not scene.find_children("*", "LudusTraining", true, false).is_empty()


## Looks for a trainer for [param settings], and starts one if there is none; [param trains]: it
## shall train as soon as it is there.
func connect_trainer(settings: LudusTraining, trains: bool = false) -> void:
	if state != LudusTraining.State.OFFLINE:
		return
	_settings = settings
	_is_start_due = trains
	_server = null
	_deadline_ms = Time.get_ticks_msec() + START_TIMEOUT_MS
	_retry_ms = 0
	message = "looking for a trainer"
	advance(Event.SEARCH)


## What the trainer is told in the greeting; empty where it guides.
func to_json() -> Dictionary:
	return _settings.to_json() if is_guiding() else {}


## The scene to train, where the trainer names none.
func scene_path() -> String:
	if is_guiding() and not _settings.scene_path.is_empty():
		return _settings.scene_path
	var current := get_tree().current_scene
	return current.scene_file_path if current != null and current != get_parent() else ""


## The worlds take the place of the current scene, unless that only names the one to train.
func replace_current_scene() -> void:
	if get_tree().current_scene == get_parent():
		return
	if not is_guiding():
		get_tree().unload_current_scene()
	elif _settings.scene_path.is_empty():
		_settings.reparent(self)
		get_tree().unload_current_scene()


## How many worlds to draw.
func visible_worlds() -> int:
	return _settings.visible_worlds if is_guiding() else 1


## Waits a moment for the trainer. Returns false if it has nothing to say; then frames pass, in
## which the game draws and hears its keys, and the worlds stand still unless they stand by.
func poll(link: LudusLink) -> bool:
	if link.wait_for_data(0 if is_standing_by else _pace.patience_ms()):
		return true
	_silent_frame = Engine.get_process_frames()
	get_tree().paused = not is_standing_by
	_pace.note_waiting()
	return false


## Whether the trainer was silent in this frame, so that it is no use to listen again.
func is_silent_frame() -> bool:
	return _silent_frame == Engine.get_process_frames()


## Takes in how training goes.
func show_status(told: Dictionary) -> void:
	if not is_guiding():
		return
	var word: String = told["state"] if told.get("state") is String else ""
	_pace.is_fast = word == "training" or not told.has("state")
	status = told
	var words: Variant = told.get("message")
	if words is String and not (words as String).is_empty():
		message = words
	if EVENTS.has(word):
		advance(EVENTS[word])
	if state == LudusTraining.State.STANDBY and _is_start_due:
		_is_start_due = false
		requests.add_guided("start")
	status_changed.emit(told)


## Goes back to a game without a trainer, after [param reason]; brings back the scene whose place
## the worlds of [param stage] took.
func end(reason: String, stage: LudusStage) -> void:
	get_tree().paused = false
	_pace.is_fast = false
	is_standing_by = false
	lose("the trainer has gone" if reason.is_empty() else reason)
	if is_instance_valid(_settings) and _settings.get_parent() == self:
		_settings.queue_free()
		get_tree().change_scene_to_packed.call_deferred(stage.scene)
	_settings = null
	if stage != null:
		stage.queue_free()


## Notes that there is no trainer, and why.
func lose(reason: String) -> void:
	disconnect_reason = reason
	message = reason
	advance(Event.LOSE)


## Goes on to what follows an event, see [constant NEXT_STATES].
func advance(event: LudusGuidedTraining.Event) -> void:
	var next: LudusTraining.State = NEXT_STATES[state].get(event, state)
	if next == state:
		return
	state = next
	set_process(state == LudusTraining.State.CONNECTING)
	state_changed.emit(state)


func _process(_delta: float) -> void:
	if not is_instance_valid(_settings):
		lose("the scene with the LudusTraining node has gone")
		return
	if Time.get_ticks_msec() < _retry_ms:
		return
	_retry_ms = Time.get_ticks_msec() + RETRY_MS
	var port := _settings.port
	var link := LudusLink.new()
	if link.connect_to(["tcp:127.0.0.1:%d" % port], CONNECT_TIMEOUT_MS):
		has_been_online = true
		disconnect_reason = ""
		message = ""
		advance(Event.FIND)
		trainer_found.emit(link)
	elif _server == null:
		_start_trainer(port)
	elif _server.has_ended():
		_give_up(_server.describe_end())
	elif Time.get_ticks_msec() > _deadline_ms:
		_give_up("no trainer answers at port %d" % port)


func _start_trainer(port: int) -> void:
	message = "starting ludus serve"
	_server = LudusTrainerProcess.new()
	var runs := _folder(_settings.runs_folder, "runs")
	if not _server.start(port, runs, _folder(_settings.policies_folder, "policies")):
		_give_up(_server.error)


func _give_up(reason: String) -> void:
	printerr("ludus: ", reason)
	lose(reason)


static func _folder(chosen: String, usual: String) -> String:
	if not chosen.is_empty():
		return ProjectSettings.globalize_path(chosen)
	var root := "res://" if OS.has_feature("editor") else "user://"
	return ProjectSettings.globalize_path(root + usual)
