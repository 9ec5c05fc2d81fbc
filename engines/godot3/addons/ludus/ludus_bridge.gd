class_name LudusBridge, "res://addons/ludus/icons/ludus_bridge.svg"
extends Node
## Joins the game with a trainer: connects, then lets exactly the asked number of ticks pass between
## two messages.
##
## The plugin makes it the autoload "Ludus". Without a trainer the game simply plays. In training
## it runs first in every tick and blocks until the next request; when the trainer goes away, the
## game quits.

## Emitted when a trainer has connected and the worlds stand.
signal training_started(num_worlds)
## Emitted before training and after every update. [param status] holds [code]agent_steps[/code],
## [code]updates[/code] and [code]policies[/code]: by name, [code]mode[/code] (a word) and
## [code]mean_return[/code] (a number, or null as long as there is none).
signal training_status(status)
## Emitted when the trainer has put a policy into another mode, and once at the start.
signal policy_mode_changed(policy, mode)

## What the bridge does in the next tick: looks for a trainer; lets people play; lets the ticks of a
## step pass; holds everything for one frame, so that new nodes join the loop; lets some worlds tick
## alone before they are observed; plays at random inside the engine; quits.
enum Phase { START, MANUAL, STEPPING, HELD, SETTLING, CEILING, ENDED }

## How a policy takes part in training: it learns; it acts as in training, with chance, and learns
## nothing; or it takes its most probable action and learns nothing.
enum PolicyMode { TRAIN, FROZEN, DETERMINISTIC }

const GROUP_NAME := "ludus_bridges"

## Plays agents that have a [LudusPolicy] while no trainer is there.
var player := LudusPolicyPlayer.new()

var _phase: int = Phase.START
var _arguments: LudusArguments
var _link: LudusLink
var _stage: LudusStage
var _game: LudusGame
var _manual: LudusManualPlay
var _ceiling: LudusCeiling
var _settling: LudusSettling
var _ticks_left: int = 0
var _num_ticks: int = 0
var _has_reset: bool = false
var _batch_flags: int = 0
var _requests := LudusRequests.new()
var _status := LudusTrainingStatus.new()
## Clock of PROTOCOL.md §7, microseconds.
var _left_us: int = 0
var _engine_us: int = 0
var _bridge_us: int = 0
var _wait_us: int = 0


## Whether the autoload is there, which plays agents or has them trained.
static func exists() -> bool:
	return not Engine.get_main_loop().get_nodes_in_group(GROUP_NAME).empty()


func _init() -> void:
	add_child(player)
	_connect_or_tell("received", "_on_status_received")
	_connect_or_tell("policy_mode_changed", "_on_policy_mode_changed")


func _enter_tree() -> void:
	if get_tree().has_group(GROUP_NAME):
		_phase = Phase.ENDED
		queue_free()
		return
	add_to_group(GROUP_NAME)
	_arguments = LudusArguments.new()
	if _arguments.parent_pid > 0:  # before scenes are loaded, which may take for ever
		_link = LudusLink.new()
		_link.watch(_arguments.parent_pid)
	pause_mode = Node.PAUSE_MODE_PROCESS
	process_priority = -1073741824


func _ready() -> void:
	player.set_physics_process(false)  # Whatever it does is asked for here.


func _exit_tree() -> void:
	if _link != null:
		_link.close()


func _physics_process(_delta: float) -> void:
	var now := OS.get_ticks_usec()
	match _phase:
		Phase.STEPPING:
			_engine_us += now - _left_us
			_num_ticks += 1
			_ticks_left -= 1
			if _ticks_left > 0:
				_repeat(now)
			else:
				_finish_step(now)
		Phase.HELD:
			get_tree().paused = false
			_game.release()
			if _hold_or_answer():
				_serve()
		Phase.SETTLING:
			_num_ticks += 1
			if _settling.advance():
				_answer()
				_serve()
		Phase.CEILING:
			if _ceiling.advance():
				_send(_ceiling.result_frame())
				_serve()
		Phase.MANUAL:
			player.advance()
			_manual.advance()
			# Six microseconds a tick that games on another wire would pay, too.
			set_physics_process(get_tree().has_group(LudusAgent.GROUP_NAME))
		Phase.START:
			_start()
	_left_us = OS.get_ticks_usec()


## Goes on after a time without agents. Called by the agent that comes.
func wake() -> void:
	set_physics_process(true)


## Asks the trainer to put a policy into another mode. Returns false if nobody trains the game, or
## if it has no such policy; the signal [signal policy_mode_changed] tells when it is done.
func set_policy_mode(policy: String, mode: int) -> bool:
	return _requests.set_mode(policy, mode)


## Asks the trainer to save a checkpoint. Returns false if nobody trains the game.
func save_checkpoint() -> bool:
	return _requests.add({"kind": "save"})


## Asks the trainer to save a checkpoint and end the run; the game then quits. Returns false if
## nobody trains the game.
func stop_training() -> bool:
	return _requests.add({"kind": "stop"})


func _connect_or_tell(signal_name: String, method: String) -> void:
	if _status.connect(signal_name, self, method) != OK:
		push_error("ludus: no signal %s" % signal_name)


func _on_status_received(status: Dictionary) -> void:
	emit_signal("training_status", status)


func _on_policy_mode_changed(policy: String, mode: int) -> void:
	emit_signal("policy_mode_changed", policy, mode)


func _repeat(now: int) -> void:
	_game.repeat_actions()
	_bridge_us += OS.get_ticks_usec() - now


func _finish_step(now: int) -> void:
	_game.collect()
	_bridge_us += OS.get_ticks_usec() - now
	if _hold_or_answer():
		_serve()


## Answers the request, unless worlds were made anew or must settle first. Returns whether it did.
func _hold_or_answer() -> bool:
	if not _game.error.empty():
		_fail("game", _game.error)
		return false
	if not _game.is_held():
		return _settle_or_answer()
	_phase = Phase.HELD
	get_tree().paused = true
	_game.hold()
	return false


func _settle_or_answer() -> bool:
	var worlds := _game.take_settling()
	if worlds.empty():
		_answer()
		return true
	_phase = Phase.SETTLING
	_settling = LudusSettling.new(_stage, worlds)
	return false


func _answer() -> void:
	var began := OS.get_ticks_usec()
	var body := _game.to_bytes()
	if not _game.error.empty():
		_fail("game", _game.error)
		return
	_bridge_us += OS.get_ticks_usec() - began
	var flags := _batch_flags | _requests.flags()
	_send(LudusWire.batch_frame(_num_ticks, _engine_us, _bridge_us, _wait_us, flags, body))


func _send(frame: PoolByteArray) -> void:
	if not _link.send(frame):
		_end("the trainer closed the connection")


## Takes requests until one lets time pass.
func _serve() -> void:
	while _link != null and _phase != Phase.ENDED:
		var asked := OS.get_ticks_usec()
		if not _link.receive():
			_fail("" if _link.error.empty() else "frame", _link.error)
			return
		var got := OS.get_ticks_usec()
		_wait_us = got - asked
		if _handle():
			_bridge_us = OS.get_ticks_usec() - got
			return


## Handles one request. Returns true if the loop of requests pauses, because ticks must pass.
func _handle() -> bool:
	match _link.type:
		LudusWire.Type.STEP:
			return _handle_step()
		LudusWire.Type.RESET:
			return _handle_reset()
		LudusWire.Type.CALL:
			return _handle_call()
		LudusWire.Type.PING:
			_send(LudusWire.raw_frame(LudusWire.Type.PONG, _link.payload))
		LudusWire.Type.CLOSE:
			_end("")
		LudusWire.Type.ERROR:
			var message = LudusWire.read_json(_link.payload)
			_end(str(message.get("message", "")) if message != null else "the trainer failed")
		_:
			_fail("sequence", "a frame of type %d is not allowed now" % _link.type)
	return false


func _handle_step() -> bool:
	if not _has_reset:
		_fail("sequence", "STEP before the first RESET")
		return false
	var num_bytes := _link.payload.size()
	if num_bytes != _game.action_bytes:
		_fail("frame", "STEP has %d bytes, expected %d" % [num_bytes, _game.action_bytes])
		return false
	var problem: String = _game.apply_actions(_link.payload)
	if not problem.empty():
		_fail("frame", problem)
		return false
	_ticks_left = _game.ticks_per_step
	_engine_us = 0
	_batch_flags = 0
	_phase = Phase.STEPPING
	return true


func _handle_reset() -> bool:
	var request := LudusWire.read_reset(_link.payload, _stage.worlds.size())
	if request.empty():
		_fail("frame", "malformed RESET")
		return false
	_has_reset = true
	_engine_us = 0
	_batch_flags = LudusWire.FLAG_RESET
	_bridge_us = 0
	_game.reset(request)
	return not _hold_or_answer()


func _handle_call() -> bool:
	var call := LudusCall.new(_link.payload)
	if call.is_ceiling():
		_ceiling = call.make_ceiling(_game)
		_phase = Phase.CEILING
		_has_reset = false
		return true
	if call.is_for_bridge():
		_send(call.answer_for_bridge(_requests, _status))
	else:
		_send(call.answer(_game))
	return false


func _start() -> void:
	_phase = Phase.MANUAL
	_manual = LudusManualPlay.new(get_tree())
	if _link == null:
		_link = LudusLink.new()
	if not _arguments.play_scene.empty():
		if not LudusOpening.show_scene(_arguments.play_scene, self):
			get_tree().quit(1)
		return
	if not LudusOpening.find_trainer(_link, _arguments):
		if _arguments.has_trainer():
			_end(_link.error)
		_link.close()
		_link = null
		return
	_link.watch(_arguments.parent_pid)
	_greet()


func _greet() -> void:
	var opening := LudusOpening.new()
	if not opening.greet(_link, _arguments, self):
		_fail(opening.code, opening.error, opening.hint)
		return
	_requests.open(opening.capabilities)
	var is_built := opening.build(self)
	_stage = opening.stage
	_game = opening.game
	if not is_built:
		_fail(opening.code, opening.error, opening.hint)
		return
	for policy in _game.policies:
		_requests.policy_names.append(policy.policy_name)
	emit_signal("training_started", _stage.worlds.size())
	_send(opening.spec_frame())
	_serve()


## Tells the trainer what is wrong and quits.
func _fail(code: String, message: String, hint: String = "") -> void:
	if not code.empty():
		var report := {"code": code, "message": message, "hint": hint}
		var _is_sent := _link.send(LudusWire.json_frame(LudusWire.Type.ERROR, report))
	_end(message if hint.empty() else "%s; %s" % [message, hint])


func _end(message: String) -> void:
	if not message.empty():
		printerr("ludus: ", message)
	_phase = Phase.ENDED
	get_tree().quit(0 if message.empty() else 1)
