extends CanvasLayer
## Tells how the training that the game guides goes: state, counters, policies, keys, mistakes.

const LudusTrainingKeys := preload("res://addons/ludus/training/training_keys.gd")

const BACKGROUND := Color(0.07, 0.09, 0.15, 0.8)
const PLAIN_COLOR := Color(0.85, 0.9, 1.0)
const DIM_COLOR := Color(0.62, 0.7, 0.85)
const WIDTH := 300.0
const MARGIN := 12.0
## Text and colour of each [enum LudusTraining.State].
const STATES: Array[Array] = [
	["no trainer", Color(0.75, 0.75, 0.78)],
	["connecting", Color(1.0, 0.78, 0.45)],
	["connecting", Color(1.0, 0.78, 0.45)],
	["stands by", Color(0.55, 0.8, 1.0)],
	["training", Color(0.5, 0.95, 0.6)],
	["plays a round", Color(1.0, 0.7, 0.95)],
]
## Keys that do something in each state, and what.
const HELP: Array[Dictionary] = [
	{&"ludus_connect": "connect"},
	{},
	{},
	{
		&"ludus_start": "train",
		&"ludus_play_round": "play a round",
		&"ludus_write_policies": "write policies",
	},
	{&"ludus_stop": "stop", &"ludus_play_round": "play a round"},
	{&"ludus_stop": "stop"},
]

var _training: LudusTraining
var _panel := PanelContainer.new()
var _title := Label.new()
var _counters := Label.new()
var _policies := GridContainer.new()
var _message := Label.new()
var _help := Label.new()
var _steps: float = 0.0
var _steps_at_ms: int = 0
var _steps_per_s: float = 0.0


func _init(training: LudusTraining) -> void:
	_training = training
	layer = 100
	process_mode = Node.PROCESS_MODE_ALWAYS
	_build()
	training.state_changed.connect(_show_state)
	training.status_changed.connect(_show_status)


func _ready() -> void:
	_show_state(_training.state)
	_show_status(_training.status)


func _process(_delta: float) -> void:
	_message.text = _training.message
	_message.visible = not _training.message.is_empty()


func _unhandled_input(event: InputEvent) -> void:
	if _training.shortcuts_enabled and event.is_action_pressed(&"ludus_overlay"):
		visible = not visible


func _build() -> void:
	var style := StyleBoxFlat.new()
	style.bg_color = BACKGROUND
	style.set_corner_radius_all(8)
	style.set_content_margin_all(MARGIN)
	_panel.add_theme_stylebox_override(&"panel", style)
	_panel.custom_minimum_size.x = WIDTH
	_panel.set_anchors_and_offsets_preset(
		Control.PRESET_TOP_RIGHT, Control.PRESET_MODE_MINSIZE, roundi(MARGIN)
	)
	_panel.grow_horizontal = Control.GROW_DIRECTION_BEGIN
	_panel.mouse_filter = Control.MOUSE_FILTER_IGNORE
	_policies.columns = 3
	_policies.add_theme_constant_override(&"h_separation", 16)
	var rows := VBoxContainer.new()
	for row: Control in [_title, _counters, _policies, _message, _help]:
		rows.add_child(row)
	for label: Label in [_message, _help]:
		label.autowrap_mode = TextServer.AUTOWRAP_WORD_SMART
	_counters.add_theme_color_override(&"font_color", DIM_COLOR)
	_help.add_theme_color_override(&"font_color", DIM_COLOR)
	_help.add_theme_font_size_override(&"font_size", 13)
	_panel.add_child(rows)
	add_child(_panel)


func _show_state(state: LudusTraining.State) -> void:
	_title.text = "Ludus: %s" % STATES[state][0]
	_title.add_theme_color_override(&"font_color", STATES[state][1] as Color)
	var parts: PackedStringArray = []
	if _training.shortcuts_enabled:
		for action: StringName in HELP[state]:
			parts.append("%s %s" % [LudusTrainingKeys.describe(action), HELP[state][action]])
		parts.append("%s hide" % LudusTrainingKeys.describe(&"ludus_overlay"))
	_help.text = "   ".join(parts)
	_steps_at_ms = 0


func _show_status(status: Dictionary) -> void:
	_counters.visible = status.has("agent_steps")
	if not _counters.visible:
		return
	_measure(float(status["agent_steps"]))
	_counters.text = "update %d    %s steps" % [status.get("updates", 0), _grouped(_steps)]
	if _training.state == LudusTraining.State.TRAINING and _steps_per_s > 0.0:
		_counters.text += "    %s/s" % _grouped(_steps_per_s)
	var policies: Variant = status.get("policies")
	if policies is Dictionary:
		_show_policies(policies)


func _measure(steps: float) -> void:
	var now := Time.get_ticks_msec()
	if _steps_at_ms > 0 and now > _steps_at_ms and steps > _steps:
		_steps_per_s = (steps - _steps) * 1000.0 / (now - _steps_at_ms)
	_steps = steps
	_steps_at_ms = now


func _show_policies(policies: Dictionary) -> void:
	while _policies.get_child_count() < 3 * policies.size():
		_policies.add_child(Label.new())
	var i := 0
	for policy: String in policies:
		var mean: Variant = policies[policy].get("mean_return")
		var texts: PackedStringArray = [policy, policies[policy].get("mode", ""), ""]
		if mean != null:
			texts[2] = "return %.2f" % mean
		for text: String in texts:
			var label := _policies.get_child(i) as Label
			label.text = text
			label.add_theme_color_override(&"font_color", PLAIN_COLOR)
			i += 1


static func _grouped(number: float) -> String:
	if number < 1e4:
		return str(roundi(number))
	return "%.1fk" % (number / 1e3) if number < 1e6 else "%.2fM" % (number / 1e6)
