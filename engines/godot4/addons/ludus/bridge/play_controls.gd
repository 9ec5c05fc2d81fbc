extends CanvasLayer
## Pause, single steps and slow motion for people who watch: keys of [code]ludus play[/code].
##
## Time is held back by pausing the tree between ticks, never by scaling it: each tick is as long as
## in training, and so episodes are the same.

const LudusRegistry := preload("res://addons/ludus/bridge/registry.gd")

const PAUSE_KEY := KEY_F1
const STEP_KEY := KEY_F2
const SLOWER_KEY := KEY_F3
## So many frames pass for one tick, in turn.
const SLOWNESSES: PackedInt32Array = [1, 2, 4, 8]

## Whether ticks pass only when they are asked for.
var is_paused: bool = false
## Frames that pass for one tick.
var slowness: int = 1
## Ticks of a single step; 0: as the first agent says.
var ticks_per_step: int = 0

var _ticks_asked: int = 0
var _num_frames: int = 0
var _is_holding: bool = false
var _label := Label.new()


func _init() -> void:
	process_mode = Node.PROCESS_MODE_ALWAYS
	layer = 127
	_label.position = Vector2(8.0, 8.0)
	add_child(_label)


## Whether the next tick may pass; holds the tree otherwise. Called once a physics frame.
func lets_pass() -> bool:
	_num_frames += 1
	var may_pass := _num_frames % slowness == 0
	if is_paused:
		may_pass = _ticks_asked > 0
		_ticks_asked = maxi(_ticks_asked - 1, 0)
	if may_pass and _is_holding:
		get_tree().paused = false
	elif not may_pass:
		get_tree().paused = true
	_is_holding = not may_pass
	return may_pass


func _input(event: InputEvent) -> void:
	var key := event as InputEventKey
	if key == null or not key.pressed:
		return
	match key.keycode:
		PAUSE_KEY:
			is_paused = not is_paused
			_ticks_asked = 0
		STEP_KEY:
			is_paused = true
			_ticks_asked += ticks_per_step if ticks_per_step > 0 else _ticks_of_agents()
		SLOWER_KEY:
			slowness = SLOWNESSES[(SLOWNESSES.find(slowness) + 1) % SLOWNESSES.size()]
		_:
			return
	_label.text = _describe()
	get_viewport().set_input_as_handled()


static func _ticks_of_agents() -> int:
	for agent: LudusAgent in LudusRegistry.agents:
		return agent.ticks_per_step
	return 1


func _describe() -> String:
	if is_paused:
		return "paused: F1 goes on, F2 takes one step"
	return "" if slowness == 1 else "speed 1/%d: F3" % slowness
