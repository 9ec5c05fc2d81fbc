extends Node
## The keys that guide training. Each is an input action.

## Keys, pressed with Shift so that the game's own stay free, of actions that neither the node nor
## the project's input map gives another.
const USUAL_KEYS: Dictionary[StringName, Key] = {
	&"ludus_overlay": KEY_F1,
	&"ludus_play_round": KEY_F2,
	&"ludus_start": KEY_F3,
	&"ludus_stop": KEY_F4,
	&"ludus_connect": KEY_F5,
	&"ludus_write_policies": KEY_F6,
	&"ludus_train_first": KEY_F7,
	&"ludus_train_second": KEY_F8,
	&"ludus_train_all": KEY_F9,
	&"ludus_train_none": KEY_F10,
}

var _training: LudusTraining


## Adds those of the actions [param usual] that the project does not have, and gives those in
## [param chosen] their key.
static func add_actions(
	chosen: Dictionary[StringName, InputEventKey],
	usual: Dictionary[StringName, Key] = USUAL_KEYS,
	is_shifted: bool = true
) -> void:
	for action: StringName in usual:
		var event: InputEventKey = chosen.get(action)
		if event == null and InputMap.has_action(action):
			continue
		if event == null:
			event = InputEventKey.new()
			event.keycode = usual[action]
			event.shift_pressed = is_shifted
		if not InputMap.has_action(action):
			InputMap.add_action(action)
		InputMap.action_erase_events(action)
		InputMap.action_add_event(action, event)


## The key of an action, for people to read.
static func describe(action: StringName) -> String:
	if not InputMap.has_action(action):
		return ""
	for event: InputEvent in InputMap.action_get_events(action):
		return event.as_text().get_slice(" (", 0)
	return ""


func _init(training: LudusTraining) -> void:
	_training = training
	add_actions(training.keys)


func _unhandled_input(event: InputEvent) -> void:
	for action: StringName in USUAL_KEYS:
		if event.is_action_pressed(action):
			_do(action)
			return


func _do(action: StringName) -> void:
	match action:
		&"ludus_connect":
			_training.connect_trainer()
		&"ludus_play_round":
			_training.play_round()
		&"ludus_start":
			_training.start()
		&"ludus_stop":
			_training.stop()
		&"ludus_write_policies":
			_training.write_policies()
		&"ludus_train_first":
			_train_one(0)
		&"ludus_train_second":
			_train_one(1)
		&"ludus_train_all":
			_training.train_only(PackedStringArray(_training.modes.keys()))
		&"ludus_train_none":
			_training.train_only([])


func _train_one(index: int) -> void:
	var names := _training.modes.keys()
	if index < names.size():
		_training.train_only([names[index]])
