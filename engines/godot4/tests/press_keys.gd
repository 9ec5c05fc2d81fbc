extends Node
## Presses keys as a person would, for tests: [code]--press=0.5:Up,2:3,4:Enter[/code] after seconds.

var _waiting: Array[PackedStringArray] = []
var _began_ms: int = Time.get_ticks_msec()


func _ready() -> void:
	process_mode = Node.PROCESS_MODE_ALWAYS
	for argument: String in OS.get_cmdline_user_args():
		if argument.begins_with("--press="):
			for part: String in argument.trim_prefix("--press=").split(","):
				_waiting.append(part.split(":"))


func _process(_delta: float) -> void:
	var passed := (Time.get_ticks_msec() - _began_ms) / 1000.0
	while not _waiting.is_empty() and float(_waiting[0][0]) <= passed:
		_press(OS.find_keycode_from_string(_waiting.pop_front()[1]))


func _press(key: Key) -> void:
	for is_pressed: bool in [true, false]:
		var event := InputEventKey.new()
		event.keycode = key
		event.physical_keycode = key
		event.pressed = is_pressed
		Input.parse_input_event(event)
