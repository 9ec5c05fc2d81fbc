class_name PhysicsFramesTimer
extends Reference
## Counts physics frames, as godot_gym_api's class of this name does.
##
## [RLEnvironment] calls [method step] in every physics frame, before its children run. The frame
## in which the count exceeds the limit is the one in which the game is paused again: its children
## and the physics server have run for exactly the limit by then.

## Emitted by the first [method step] beyond the limit.
signal timer_end

## Whether it counts.
var is_started: bool = false

var _limit: int
var _counter: int = 0


## Takes the number of physics frames.
func _init(limit: int = 4) -> void:
	_limit = limit


## Counts one physics frame.
func step() -> void:
	if not is_started:
		return
	_counter += 1
	if _counter > _limit:
		finish()


## Begins to count from zero; returns itself, so that one can [code]yield[/code] right away.
func start() -> PhysicsFramesTimer:
	_counter = 0
	is_started = true
	return self


## Ends at once, if it counts.
func finish() -> void:
	if is_started:
		_counter = 0
		is_started = false
		emit_signal("timer_end")


## Sets the number of physics frames.
func set_limit(new_limit: int) -> void:
	_limit = new_limit
