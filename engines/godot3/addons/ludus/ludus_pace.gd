class_name LudusPace
extends Node
## How fast the game's time passes while it guides its own training: as fast as it can, or so that
## people can watch.
##
## Fast means: far more ticks per second than the machine can do, each as long as ever for the game
## ([code]delta[/code] stays what it is). As many of them are put between two pictures as to leave
## drawing a tenth of the time: Godot 3 does no more than 8 in a frame, so frames are left undrawn.
## A process that was started with [code]--fixed-fps[/code] is fast already and is left alone, where
## the system tells of it.

## Ticks per second are multiplied by this; no machine gets so far.
const FACTOR := 1000
## Ticking lasts this many times as long as drawing and everything else of a frame.
const TICKING_PER_DRAWING := 9.0
## Limits of the time that ticks get between two pictures, microseconds.
const MIN_TICKING_US := 15000.0
const MAX_TICKING_US := 500000.0
## Share of the newest picture in the measured times.
const NEWEST := 0.2
## How long a frame without a screen sleeps, microseconds.
const SHORT_SLEEP_US := 1
const OWN_COMMAND_LINE := "/proc/self/cmdline"
const MAX_COMMAND_LINE_BYTES := 65536
const WATCHED_TICKS := "watched_ticks"
const INSTANCE := "instance"
## Ticks per second while people watch, chosen by [method watch_at], 0 for the project's; and the
## pace there is. Godot 3 has no static variables; what a constant dictionary holds is shared all
## the same.
const _SHARED := {WATCHED_TICKS: 0, INSTANCE: null}

## Whether time passes as fast as it can.
var is_fast: bool = false setget set_fast

var _is_fixed: bool = _has_fixed_fps()
var _usual_ticks: int = Engine.iterations_per_second
var _usual_scale: float = Engine.time_scale
var _usual_jitter_fix: float = Engine.physics_jitter_fix
var _usual_sleep_us: int = OS.low_processor_usage_mode_sleep_usec
var _usual_vsync: bool = OS.vsync_enabled
## Whether nothing but this class decides when pictures are drawn.
var _has_render_loop: bool = VisualServer.render_loop_enabled
## Time that ticks get between two pictures.
var _ticking_us: float = MIN_TICKING_US
## When the ticks since the last picture began, 0 if there was none; and when the last ones ended.
var _ticks_began_us: int = 0
var _ticks_ended_us: int = 0
var _drawing_us: float = 0.0


## Lets a game whose step is a tick or two be slow enough to be watched: [param ticks_per_second]
## while it is played by hand or plays a round, 0 for the project's. The length of a tick stays.
static func watch_at(ticks_per_second: int) -> void:
	_SHARED[WATCHED_TICKS] = ticks_per_second
	var instance: Node = _SHARED[INSTANCE]
	if instance != null and not instance.is_fast:
		instance._choose()


func set_fast(value: bool) -> void:
	if value != is_fast and not _is_fixed:
		is_fast = value
		_choose()


## How long the trainer may keep a frame waiting, milliseconds: as long as ticks have until the next
## picture.
func patience_ms() -> int:
	var spent_us := OS.get_ticks_usec() - _ticks_began_us if _ticks_began_us > 0 else 0
	return int(ceil(max(_ticking_us - spent_us, 0.0) / 1000.0))


func _init() -> void:
	name = "Pace"
	pause_mode = Node.PAUSE_MODE_PROCESS
	process_priority = -1073741825


func _enter_tree() -> void:
	_SHARED[INSTANCE] = self
	if _SHARED[WATCHED_TICKS] > 0:
		_choose()


func _exit_tree() -> void:
	set_fast(false)
	if _SHARED[INSTANCE] == self:
		_SHARED[INSTANCE] = null


func _physics_process(_delta: float) -> void:
	if not is_fast or _ticks_began_us > 0:
		return
	_ticks_began_us = OS.get_ticks_usec()
	if _ticks_ended_us > 0:
		_drawing_us = lerp(_drawing_us, _ticks_began_us - _ticks_ended_us, NEWEST)
		var ticking_us := _drawing_us * TICKING_PER_DRAWING
		_ticking_us = clamp(ticking_us, MIN_TICKING_US, MAX_TICKING_US)


func _process(_delta: float) -> void:
	if not is_fast or _ticks_began_us == 0:
		return
	var now := OS.get_ticks_usec()
	var is_due := now - _ticks_began_us >= _ticking_us
	VisualServer.render_loop_enabled = _has_render_loop and is_due
	if is_due:
		_ticks_began_us = 0
		_ticks_ended_us = now


func _choose() -> void:
	_ticking_us = MIN_TICKING_US
	_ticks_began_us = 0
	_ticks_ended_us = 0
	var ticks := _usual_ticks * FACTOR
	if not is_fast:
		ticks = _SHARED[WATCHED_TICKS] if _SHARED[WATCHED_TICKS] > 0 else _usual_ticks
	Engine.iterations_per_second = ticks
	Engine.time_scale = _usual_scale * ticks / _usual_ticks
	Engine.physics_jitter_fix = 0.0 if is_fast else _usual_jitter_fix
	OS.low_processor_usage_mode_sleep_usec = SHORT_SLEEP_US if is_fast else _usual_sleep_us
	VisualServer.render_loop_enabled = _has_render_loop
	OS.vsync_enabled = _usual_vsync and not is_fast


## Godot 3 does not tell a game of it.
static func _has_fixed_fps() -> bool:
	var file := File.new()
	if file.open(OWN_COMMAND_LINE, File.READ) != OK:
		return false
	var bytes := file.get_buffer(MAX_COMMAND_LINE_BYTES)
	file.close()
	for i in bytes.size():
		if bytes[i] == 0:
			bytes[i] = ord(" ")
	return " --fixed-fps " in bytes.get_string_from_utf8()
