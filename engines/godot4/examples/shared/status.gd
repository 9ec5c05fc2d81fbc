extends CanvasLayer
## A panel with what a simulation's [code]status()[/code] returns: names to short texts.

var _simulation: LudusSimulation
var _values: Dictionary[String, Label] = {}

@onready var _rows: GridContainer = %Rows


func _ready() -> void:
	var stage := owner if owner != null else get_parent()
	var host := stage.get_parent() as LudusSimulationHost
	visible = host != null and host.simulation != null
	if visible:
		_simulation = host.simulation


func _process(_delta: float) -> void:
	if _simulation == null:
		return
	var status: Dictionary = _simulation.call(&"status")
	for key: String in status:
		if not _values.has(key):
			_add_row(key)
		_values[key].text = str(status[key])


func _add_row(key: String) -> void:
	var key_label := Label.new()
	key_label.text = key
	key_label.size_flags_horizontal = Control.SIZE_EXPAND_FILL
	key_label.add_theme_color_override(&"font_color", Color(0.62, 0.7, 0.85))
	_rows.add_child(key_label)
	var value := Label.new()
	value.horizontal_alignment = HORIZONTAL_ALIGNMENT_RIGHT
	_rows.add_child(value)
	_values[key] = value
