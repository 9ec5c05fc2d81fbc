extends CanvasLayer
## Counts how the episodes of an example ended: one way or the other.

## Signal of the world's root; its first argument says whether it went the one way.
@export var signal_name: StringName
## What the one way is called.
@export var yes_word: String
## What the other way is called.
@export var no_word: String
@export var yes_color := Color.WHITE
@export var no_color := Color.WHITE

var _num_yes: int = 0
var _num_no: int = 0

@onready var _yes: Label = %Yes
@onready var _no: Label = %No


func _ready() -> void:
	_yes.add_theme_color_override(&"font_color", yes_color)
	_no.add_theme_color_override(&"font_color", no_color)
	var stage := owner if owner != null else get_parent()
	var root := stage.get_parent()
	if root.has_signal(signal_name):
		root.connect(signal_name, _on_ended)
	_write()


func _on_ended(is_yes: bool, _detail: Variant = null) -> void:
	_num_yes += int(is_yes)
	_num_no += int(not is_yes)
	_write()


func _write() -> void:
	_yes.text = "%s %d" % [yes_word, _num_yes]
	_no.text = "%s %d" % [no_word, _num_no]
