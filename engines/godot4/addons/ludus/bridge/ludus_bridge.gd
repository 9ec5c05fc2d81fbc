@icon("res://addons/ludus/icons/ludus_bridge.svg")
extends Node
## Joins the game with a trainer: connects, then lets exactly the asked number of ticks pass between
## two messages.
##
## The plugin makes it the autoload "Ludus". Without a trainer the game simply plays. In training
## it runs first in every tick and blocks until the next request; when the trainer goes away, the
## game quits.

## Emitted when a trainer has connected and the worlds stand.
signal training_started(num_worlds: int)
## Emitted before training and after every update; who learns next may be asked for in it, see
## [method set_policy_mode]. [param status] holds [code]agent_steps[/code],
## [code]updates[/code] and [code]policies[/code]: by name, [code]mode[/code] (a word) and
## [code]mean_return[/code] (a number, or null as long as there is none).
signal training_status(status: Dictionary)
## Emitted when the trainer has put a policy into another mode, and once at the start.
signal policy_mode_changed(policy: String, mode: LudusBridge.PolicyMode)

## What the bridge does in the next tick.
enum Phase {
	START,  ## Look for a trainer.
	MANUAL,  ## No trainer: people play.
	STEPPING,  ## The ticks of a step pass.
	HELD,  ## Everything is paused for one frame, so that new nodes join the loop.
	SETTLING,  ## Some worlds tick alone before they are observed.
	CEILING,  ## Random play inside the engine.
	WAITING,  ## The trainer is silent: frames pass, worlds stand still. Only in a guiding game.
	STANDING_BY,  ## The game goes on by itself until the trainer wants something.
	PASSING,  ## One frame passes without a step, as the person who plays has not chosen yet.
	ENDED,  ## The game quits.
}

const LudusArguments := preload("res://addons/ludus/bridge/arguments.gd")
## This script: a type without it is first the game's global class of that name.
const LudusBridgeNode := preload("res://addons/ludus/bridge/ludus_bridge.gd")
const LudusCall := preload("res://addons/ludus/bridge/call.gd")
const LudusCeiling := preload("res://addons/ludus/bridge/ceiling.gd")
const LudusGame := preload("res://addons/ludus/world/game.gd")
const LudusGuidedTraining := preload("res://addons/ludus/training/guided_training.gd")
const LudusLink := preload("res://addons/ludus/bridge/link.gd")
const LudusManualPlay := preload("res://addons/ludus/bridge/manual_play.gd")
const LudusMetrics := preload("res://addons/ludus/bridge/metrics.gd")
const LudusPolicyBatch := preload("res://addons/ludus/agent/policy_batch.gd")
const LudusRegistry := preload("res://addons/ludus/bridge/registry.gd")
const LudusPlayControls := preload("res://addons/ludus/bridge/play_controls.gd")
const LudusRequests := preload("res://addons/ludus/bridge/requests.gd")
const LudusSessionSetup := preload("res://addons/ludus/bridge/session_setup.gd")
const LudusStage := preload("res://addons/ludus/world/stage.gd")
const LudusWire := preload("res://addons/ludus/bridge/wire.gd")

const NOT_TRAINABLE := (
	"exported without the feature `ludus`: " + "add it to the preset's custom features"
)
## Phases in which a person who watches may hold time.
const PLAYED_PHASES: Array[LudusBridgeNode.Phase] = [
	Phase.STEPPING, Phase.MANUAL, Phase.STANDING_BY
]

## Plays agents that have a [LudusPolicy] while no trainer is there.
var player := LudusPolicyPlayer.new()
## Training that the game guides; see [LudusTraining].
var guided: LudusGuidedTraining

var _phase: LudusBridgeNode.Phase = Phase.START
var _arguments: LudusArguments
var _link: LudusLink
var _controls: LudusPlayControls
var _stage: LudusStage
var _game: LudusGame
var _manual: LudusManualPlay
var _ceiling: LudusCeiling
var _ticks_left: int = 0
var _num_ticks: int = 0
var _has_reset: bool = false
var _batch_flags: int = 0
var _requests := LudusRequests.new()
var _metrics := LudusMetrics.new()
## Clock of PROTOCOL.md §7, microseconds.
var _left_us: int = 0
var _engine_us: int = 0
var _bridge_us: int = 0
var _wait_us: int = 0


## Whether people see the game who may see what its agents see.
func is_watchable() -> bool:
	var is_drawn := DisplayServer.get_name() != "headless"
	var is_for_people := _arguments.has_controls or _arguments.has_debug_view
	return is_drawn and (LudusBridge.is_trainable() or is_for_people)


func _init() -> void:
	guided = LudusGuidedTraining.new(_requests)
	add_child(player)
	add_child(guided)
	guided.trainer_found.connect(_guide, CONNECT_DEFERRED)
	_requests.status_received.connect(_show_status)
	_requests.policy_mode_changed.connect(policy_mode_changed.emit)


func _enter_tree() -> void:
	if LudusRegistry.bridge != null:
		queue_free()
		return
	LudusRegistry.bridge = self
	_arguments = LudusArguments.read()
	if _arguments.parent_pid > 0:  # before scenes are loaded, which may take for ever
		_link = LudusLink.new()
		_link.watch(_arguments.parent_pid)
	process_mode = Node.PROCESS_MODE_ALWAYS
	process_physics_priority = -1073741824
	if _arguments.has_controls:
		_controls = LudusPlayControls.new()
		add_child(_controls)
	if is_watchable():
		var view := LudusDebugView.new()
		add_child(view)
		if _arguments.has_debug_view:
			view.show_view()


func _exit_tree() -> void:
	if LudusRegistry.bridge == self:
		LudusRegistry.bridge = null
	if _link != null:
		_link.close()


func _physics_process(_delta: float) -> void:
	if _controls != null and _phase in PLAYED_PHASES and not _controls.lets_pass():
		return
	var now := Time.get_ticks_usec()
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
			if _stage.advance_settling():
				_answer()
				_serve()
			elif not _stage.error.is_empty():
				_fail("game", _stage.error)
		Phase.CEILING:
			if _ceiling.advance():
				_send(_ceiling.result_frame())
				_serve()
		Phase.MANUAL:
			player.advance()
			_manual.advance()
		Phase.WAITING:
			if not guided.is_silent_frame():
				get_tree().paused = false
				_serve()
		Phase.STANDING_BY:
			player.advance()
			_manual.advance()
			_serve()
		Phase.PASSING:
			_serve()
		Phase.START:
			_start()
	_left_us = Time.get_ticks_usec()


## Adds a value to a metric of the run; [param reporter] is named if that cannot be. Does nothing
## where nobody trains the game. Use [method LudusWorld.report_metric].
func report_metric(metric: String, value: float, reporter: Node) -> void:
	_metrics.add(metric, value, reporter)


## Asks the trainer to put a policy into another mode. Returns false if nobody trains the game, or
## if it has no such policy; the signal [signal policy_mode_changed] tells when it is done.
func set_policy_mode(policy: String, mode: LudusBridge.PolicyMode) -> bool:
	return _requests.set_mode(policy, mode)


## Asks the trainer to save a checkpoint. Returns false if nobody trains the game.
func save_checkpoint() -> bool:
	return _requests.add({"kind": "save"})


## Asks the trainer to save a checkpoint and end the run; the game then quits. Where the game guides
## its training, the trainer stands by instead. Returns false if nobody trains the game.
func stop_training() -> bool:
	return _requests.add({"kind": "stop"})


## Asks the trainer to train until [method stop_training]. Returns false if the game does not guide
## its training, see [LudusTraining].
func start_training() -> bool:
	return _requests.add_guided("start")


## Asks the trainer to play one round with the most probable actions. Returns false if the game does
## not guide its training.
func play_round() -> bool:
	return _requests.add_guided("play_round")


## Asks the trainer to write all policies as files for the game. Returns false if the game does not
## guide its training.
func write_policies() -> bool:
	return _requests.add_guided("write_policies")


## Asks the trainer to tell of every decision for an agent, as it is shown; an empty name of a
## policy ends that. Only of a trainer that plays for people, who started the game.
func watch_agent(policy: String, slot: int) -> void:
	var is_for_people := _arguments.has_controls or _arguments.has_debug_view
	if is_for_people and _requests.refusal.is_empty():
		_requests.add({"kind": "watch", "policy": policy, "slot": slot})


func _repeat(now: int) -> void:
	_game.repeat_actions()
	_bridge_us += Time.get_ticks_usec() - now


func _finish_step(now: int) -> void:
	_game.collect()
	_bridge_us += Time.get_ticks_usec() - now
	if _hold_or_answer():
		_serve()


## Answers the request, unless worlds were made anew or must settle first. Returns whether it did.
func _hold_or_answer() -> bool:
	var error := _game.error if _metrics.error.is_empty() else _metrics.error
	if not error.is_empty():
		_fail("game", error)
		return false
	if not _game.is_held():
		return _settle_or_answer()
	_phase = Phase.HELD
	get_tree().paused = true
	return false


func _settle_or_answer() -> bool:
	var worlds := _game.take_settling()
	if worlds.is_empty():
		_answer()
		return true
	_phase = Phase.SETTLING
	_stage.begin_settling(worlds)
	return false


func _answer() -> void:
	var began := Time.get_ticks_usec()
	var frame := LudusWire.begin(LudusWire.Type.BATCH)
	frame.resize(LudusWire.HEADER_BYTES + LudusWire.BATCH_HEAD_BYTES)
	_game.append_to(frame)
	if not _game.error.is_empty():
		_fail("game", _game.error)
		return
	_bridge_us += Time.get_ticks_usec() - began
	frame.encode_u64(8, _num_ticks)
	frame.encode_u32(16, _engine_us)
	frame.encode_u32(20, _bridge_us)
	frame.encode_u32(24, _wait_us)
	var view := LudusRegistry.shown_debug_view()
	if view != null:
		view.take_batch(_game, frame, _batch_flags & LudusWire.FLAG_RESET != 0)
	frame.encode_u32(28, _batch_flags | _requests.flags())
	_send(LudusWire.finish(frame))


func _send(frame: PackedByteArray) -> void:
	if not _link.send(frame):
		_end("the trainer closed the connection")


## Takes requests until one lets time pass.
func _serve() -> void:
	while _link != null and _phase != Phase.ENDED:
		var asked := Time.get_ticks_usec()
		if _requests.is_guided and not guided.poll(_link):
			_phase = Phase.STANDING_BY if guided.is_standing_by else Phase.WAITING
			return
		if not _link.receive():
			_fail("" if _link.error.is_empty() else "frame", _link.error)
			return
		var got := Time.get_ticks_usec()
		_wait_us = got - asked
		if _handle():
			_bridge_us = Time.get_ticks_usec() - got
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
			var message: Variant = LudusWire.read_json(_link.payload)
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
	var problem := _game.apply_actions(_link.payload)
	if not problem.is_empty():
		_fail("frame", problem)
		return false
	var view := LudusRegistry.shown_debug_view()
	if view != null:
		view.take_actions(_game, _link.payload)
	_ticks_left = _game.ticks_per_step
	if _controls != null:
		_controls.ticks_per_step = _ticks_left
	_engine_us = 0
	_batch_flags = 0
	_phase = Phase.STEPPING
	return true


func _handle_reset() -> bool:
	var request := LudusWire.read_reset(_link.payload, _stage.worlds.size())
	if request.is_empty():
		_fail("frame", "malformed RESET")
		return false
	_has_reset = true
	guided.is_standing_by = false
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
	if call.is_frame_passed():
		_phase = Phase.PASSING
		_send(call.answer_nothing())
		return true
	if call.is_stand_by():
		guided.is_standing_by = _requests.is_guided
		_send(call.answer_nothing())
	elif call.is_for_bridge():
		_send(call.answer_for_bridge(_requests, _metrics))
	else:
		_send(call.answer(_game))
	return false


func _start() -> void:
	_phase = Phase.MANUAL
	_manual = LudusManualPlay.new()
	if not LudusBridge.is_trainable() and _arguments.play_scene.is_empty():
		if _arguments.has_trainer():
			_end(NOT_TRAINABLE)
		return
	if not LudusBridge.has_trainer_arguments() and guided.is_in_scene():
		return
	if _link == null:
		_link = LudusLink.new()
	if not _arguments.play_scene.is_empty():
		if not LudusSessionSetup.show_scene(_arguments.play_scene, self):
			get_tree().quit(1)
		return
	if not LudusSessionSetup.find_trainer(_link, _arguments):
		if _arguments.has_trainer():
			_end(_link.error)
		_link.close()
		_link = null
		return
	_link.watch(_arguments.parent_pid)
	_greet()


func _guide(link: LudusLink) -> void:
	if _phase != Phase.MANUAL:
		link.close()
		guided.lose("the game is being trained already")
		return
	_link = link
	_greet()


func _show_status(status: Dictionary) -> void:
	training_status.emit(status)
	guided.show_status(status)


func _greet() -> void:
	var setup := LudusSessionSetup.new(_link, _arguments)
	if not setup.greet(guided):
		_fail(setup.code, setup.error, setup.hint)
		return
	_requests.open(setup.capabilities)
	_metrics.is_open = LudusMetrics.CAPABILITY in setup.capabilities
	var is_built := setup.build(guided, self)
	_stage = setup.stage
	_game = setup.game
	if not is_built:
		_fail(setup.code, setup.error, setup.hint)
		return
	for policy: LudusPolicyBatch in _game.policies:
		_requests.policy_names.append(policy.policy_name)
	training_started.emit(_stage.worlds.size())
	_send(setup.spec_frame())
	_serve()


## Tells the trainer what is wrong and quits.
func _fail(code: String, message: String, hint: String = "") -> void:
	if not code.is_empty():
		var report := {"code": code, "message": message, "hint": hint}
		_link.send(LudusWire.json_frame(LudusWire.Type.ERROR, report))
	_end(message if hint.is_empty() else "%s; %s" % [message, hint])


func _end(message: String) -> void:
	if not message.is_empty():
		printerr("ludus: ", message)
	if guided.is_guiding():
		_go_on_without_trainer(message)
		return
	_phase = Phase.ENDED
	get_tree().quit(0 if message.is_empty() else 1)


func _go_on_without_trainer(message: String) -> void:
	_phase = Phase.MANUAL
	_has_reset = false
	_requests.close()
	_metrics = LudusMetrics.new()
	_link.close()
	_link = null
	guided.end(message, _stage)
	_stage = null
	_game = null
