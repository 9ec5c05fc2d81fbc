extends Node
## The keys that guide training. Each is an input action, which the project may define otherwise in
## its input map.

## Actions and the keys they have where the project does not define them.
const KEYS: Dictionary[StringName, Array] = {
	&"ludus_connect": [KEY_UP],
	&"ludus_play_round": [KEY_2, KEY_KP_2],
	&"ludus_start": [KEY_3, KEY_KP_3],
	&"ludus_stop": [KEY_ENTER, KEY_KP_ENTER],
	&"ludus_write_policies": [KEY_O],
	&"ludus_train_first": [KEY_7, KEY_KP_7],
	&"ludus_train_second": [KEY_8, KEY_KP_8],
	&"ludus_train_all": [KEY_9, KEY_KP_9],
	&"ludus_train_none": [KEY_0, KEY_KP_0],
	&"ludus_overlay": [KEY_F1],
}

var _training: LudusTraining


## Adds the actions that the project does not have.
static func add_actions() -> void:
	for action: StringName in KEYS:
		if InputMap.has_action(action):
			continue
		InputMap.add_action(action)
		for key: Key in KEYS[action]:
			var event := InputEventKey.new()
			event.keycode = key
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
	add_actions()


func _unhandled_input(event: InputEvent) -> void:
	for action: StringName in KEYS:
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
