extends Node
## How fast the game's time passes while it guides its own training: as fast as it can, or so that
## people can watch.
##
## Fast means: far more ticks per second than the machine can do, each as long as ever for the game
## ([code]delta[/code] stays what it is). As many of them are put between two pictures as to leave
## drawing a tenth of the time. A process that was started with [code]--fixed-fps[/code] is fast
## already and is left alone.

const LudusRegistry := preload("res://addons/ludus/bridge/registry.gd")

## Ticks per second are multiplied by this; no machine gets so far.
const FACTOR := 1000
## Ticking lasts this many times as long as drawing and everything else of a frame.
const TICKING_PER_DRAWING := 9.0
## Limits of the time that ticks get in a frame, microseconds.
const MIN_TICKING_US := 15000.0
const MAX_TICKING_US := 500000.0
## Share of the newest frame in the measured times.
const NEWEST := 0.2

## Whether time passes as fast as it can.
var is_fast: bool = false:
	set(value):
		if value != is_fast and not _is_fixed:
			is_fast = value
			choose()

var _is_fixed: bool = OS.get_cmdline_args().has("--fixed-fps")
var _usual_ticks: int = Engine.physics_ticks_per_second
var _usual_scale: float = Engine.time_scale
var _usual_jitter_fix: float = Engine.physics_jitter_fix
var _usual_steps: int = Engine.max_physics_steps_per_frame
var _usual_vsync: DisplayServer.VSyncMode
var _num_ticks: int = 0
var _max_ticks: int = 1
## Time that ticks get in a frame.
var _ticking_us: float = MIN_TICKING_US
## Whether the ticks of this frame say nothing about how long a tick lasts.
var _has_waited: bool = false
var _ticks_began_us: int = 0
var _ticks_ended_us: int = 0
var _tick_us: float = 1000.0
var _drawing_us: float = 0.0


## How long the trainer may keep a frame waiting, milliseconds: as long as ticks have in this frame.
func patience_ms() -> int:
	var spent_us := Time.get_ticks_usec() - _ticks_began_us if _num_ticks > 0 else 0
	return ceili(maxf(_ticking_us - spent_us, 0.0) / 1000.0)


## Tells that ticks of this frame were left out, because the trainer had nothing to say.
func note_waiting() -> void:
	_has_waited = true


## Sets the ticks per second and the time scale that are due.
func choose() -> void:
	_num_ticks = 0
	_max_ticks = 1
	_ticking_us = MIN_TICKING_US
	_ticks_ended_us = 0
	var ticks := _usual_ticks * FACTOR
	if not is_fast:
		ticks = LudusRegistry.watched_ticks if LudusRegistry.watched_ticks > 0 else _usual_ticks
	Engine.physics_ticks_per_second = ticks
	Engine.time_scale = _usual_scale * ticks / _usual_ticks
	Engine.physics_jitter_fix = 0.0 if is_fast else _usual_jitter_fix
	Engine.max_physics_steps_per_frame = 1 if is_fast else _usual_steps
	if DisplayServer.get_name() != "headless":
		var vsync := DisplayServer.VSYNC_DISABLED if is_fast else _usual_vsync
		DisplayServer.window_set_vsync_mode(vsync)


func _init() -> void:
	name = "Pace"
	process_mode = Node.PROCESS_MODE_ALWAYS
	process_priority = -1073741824
	process_physics_priority = -1073741825
	if DisplayServer.get_name() != "headless":
		_usual_vsync = DisplayServer.window_get_vsync_mode()


func _enter_tree() -> void:
	LudusRegistry.pace = self
	if LudusRegistry.watched_ticks > 0:
		choose()


func _exit_tree() -> void:
	is_fast = false
	if LudusRegistry.pace == self:
		LudusRegistry.pace = null


func _physics_process(_delta: float) -> void:
	if not is_fast:
		return
	if _num_ticks == 0:
		_ticks_began_us = Time.get_ticks_usec()
		if _ticks_ended_us > 0:
			_drawing_us = lerpf(_drawing_us, _ticks_began_us - _ticks_ended_us, NEWEST)
			var ticking_us := _drawing_us * TICKING_PER_DRAWING
			_ticking_us = clampf(ticking_us, MIN_TICKING_US, MAX_TICKING_US)
	_num_ticks += 1


func _process(_delta: float) -> void:
	if not is_fast or _num_ticks == 0:
		return
	_ticks_ended_us = Time.get_ticks_usec()
	var newest := float(_ticks_ended_us - _ticks_began_us) / _num_ticks
	_num_ticks = 0
	if _has_waited:
		_has_waited = false
		return
	_tick_us = maxf(lerpf(_tick_us, newest, NEWEST), 1.0)
	var num_ticks := clampi(roundi(_ticking_us / _tick_us), 1, 2 * _max_ticks)
	_max_ticks = num_ticks
	Engine.max_physics_steps_per_frame = num_ticks
