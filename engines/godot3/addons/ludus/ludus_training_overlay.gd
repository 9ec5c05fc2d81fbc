class_name LudusTrainingOverlay
extends CanvasLayer
## Tells how the training that the game guides goes: state, counters, policies, keys, mistakes.

const BACKGROUND := Color(0.07, 0.09, 0.15, 0.8)
const PLAIN_COLOR := Color(0.85, 0.9, 1.0)
const DIM_COLOR := Color(0.62, 0.7, 0.85)
const WIDTH := 300.0
const MARGIN := 12.0
## Text and colour of each [enum LudusTraining.State].
const STATES := [
	["no trainer", Color(0.75, 0.75, 0.78)],
	["connecting", Color(1.0, 0.78, 0.45)],
	["stands by", Color(0.55, 0.8, 1.0)],
	["training", Color(0.5, 0.95, 0.6)],
	["plays a round", Color(1.0, 0.7, 0.95)],
]
## Keys that do something in each state, and what.
const HELP := [
	{"ludus_connect": "connect"},
	{},
	{
		"ludus_start": "train",
		"ludus_play_round": "play a round",
		"ludus_write_policies": "write policies",
	},
	{"ludus_stop": "stop", "ludus_play_round": "play a round"},
	{"ludus_stop": "stop"},
]

## The [LudusTraining].
var _training: Node
var _panel := PanelContainer.new()
var _title := Label.new()
var _counters := Label.new()
var _policies := GridContainer.new()
var _message := Label.new()
var _help := Label.new()
var _steps: float = 0.0
var _steps_at_ms: int = 0
var _steps_per_s: float = 0.0


func _init(training: Node) -> void:
	_training = training
	layer = 100
	pause_mode = Node.PAUSE_MODE_PROCESS
	_build()
	for signal_name in ["state_changed", "status_changed"]:
		if training.connect(signal_name, self, "_on_" + signal_name) != OK:
			push_error("ludus: no signal %s" % signal_name)


func _ready() -> void:
	_on_state_changed(_training.state)
	_on_status_changed(_training.status)


func _process(_delta: float) -> void:
	_message.text = _training.message
	_message.visible = not _training.message.empty()


func _unhandled_input(event: InputEvent) -> void:
	if _training.has_keys and event.is_action_pressed("ludus_overlay"):
		_panel.visible = not _panel.visible


func _build() -> void:
	var style := StyleBoxFlat.new()
	style.bg_color = BACKGROUND
	style.set_corner_radius_all(8)
	for margin in [MARGIN_LEFT, MARGIN_TOP, MARGIN_RIGHT, MARGIN_BOTTOM]:
		style.set_default_margin(margin, MARGIN)
	_panel.add_stylebox_override("panel", style)
	_panel.rect_min_size = Vector2(WIDTH, 0.0)
	_panel.set_anchors_and_margins_preset(
		Control.PRESET_TOP_RIGHT, Control.PRESET_MODE_MINSIZE, int(MARGIN)
	)
	_panel.grow_horizontal = Control.GROW_DIRECTION_BEGIN
	_panel.mouse_filter = Control.MOUSE_FILTER_IGNORE
	_policies.columns = 3
	_policies.add_constant_override("hseparation", 16)
	var rows := VBoxContainer.new()
	for row in [_title, _counters, _policies, _message, _help]:
		rows.add_child(row)
	for label in [_message, _help]:
		label.autowrap = true
	_counters.add_color_override("font_color", DIM_COLOR)
	_help.add_color_override("font_color", DIM_COLOR)
	_panel.add_child(rows)
	add_child(_panel)


func _on_state_changed(state: int) -> void:
	_title.text = "Ludus: %s" % STATES[state][0]
	_title.add_color_override("font_color", STATES[state][1])
	var parts := PoolStringArray()
	if _training.has_keys:
		for action in HELP[state]:
			parts.append("%s %s" % [LudusTrainingKeys.describe(action), HELP[state][action]])
		parts.append("%s hide" % LudusTrainingKeys.describe("ludus_overlay"))
	_help.text = parts.join("   ")
	_steps_at_ms = 0


func _on_status_changed(status: Dictionary) -> void:
	_counters.visible = status.has("agent_steps")
	if not _counters.visible:
		return
	_measure(float(status["agent_steps"]))
	_counters.text = "update %d    %s steps" % [status.get("updates", 0), _grouped(_steps)]
	if _training.state == _training.State.TRAINING and _steps_per_s > 0.0:
		_counters.text += "    %s/s" % _grouped(_steps_per_s)
	var policies = status.get("policies")
	if policies is Dictionary:
		_show_policies(policies)


func _measure(steps: float) -> void:
	var now := OS.get_ticks_msec()
	if _steps_at_ms > 0 and now > _steps_at_ms and steps > _steps:
		_steps_per_s = (steps - _steps) * 1000.0 / (now - _steps_at_ms)
	_steps = steps
	_steps_at_ms = now


func _show_policies(policies: Dictionary) -> void:
	while _policies.get_child_count() < 3 * policies.size():
		_policies.add_child(Label.new())
	var i := 0
	for policy in policies:
		var mean = policies[policy].get("mean_return")
		var texts := [policy, policies[policy].get("mode", ""), ""]
		if mean != null:
			texts[2] = "return %.2f" % mean
		for text in texts:
			var label := _policies.get_child(i) as Label
			label.text = text
			label.add_color_override("font_color", PLAIN_COLOR)
			i += 1


static func _grouped(number: float) -> String:
	if number < 1e4:
		return str(round(number))
	return "%.1fk" % (number / 1e3) if number < 1e6 else "%.2fM" % (number / 1e6)
