@tool
extends EditorPlugin
## Registers the bridge as the autoload "Ludus", and the panel below the editor; the nodes register
## themselves by class name.

const LudusAgentInspector := preload("res://addons/ludus/editor/agent_inspector.gd")
const LudusDock := preload("res://addons/ludus/editor/dock.gd")
const LudusTrainerProcess := preload("res://addons/ludus/training/trainer_process.gd")

const AUTOLOAD_NAME := "Ludus"
const BRIDGE_PATH := "res://addons/ludus/bridge/ludus_bridge.gd"

var _dock: LudusDock
var _inspector := LudusAgentInspector.new()


## Adds no autoload: a person who has deleted it knows why. [code]ludus addon install[/code], after
## which [method _enable_plugin] is never called, has put it into the project file.
func _enter_tree() -> void:
	_offer_python_setting()
	_dock = LudusDock.new()
	_dock.undo_redo = get_undo_redo()
	add_control_to_bottom_panel(_dock, "Ludus")
	add_inspector_plugin(_inspector)


func _exit_tree() -> void:
	remove_inspector_plugin(_inspector)
	remove_control_from_bottom_panel(_dock)
	_dock.queue_free()


func _enable_plugin() -> void:
	add_autoload_singleton(AUTOLOAD_NAME, BRIDGE_PATH)


func _disable_plugin() -> void:
	remove_autoload_singleton(AUTOLOAD_NAME)


## Shows the setting among the project's, see [LudusTrainerProcess].
func _offer_python_setting() -> void:
	var setting := LudusTrainerProcess.PYTHON_SETTING
	if not ProjectSettings.has_setting(setting):
		ProjectSettings.set_setting(setting, "")
	ProjectSettings.set_initial_value(setting, "")
	ProjectSettings.set_as_basic(setting, true)
	ProjectSettings.add_property_info(
		{"name": setting, "type": TYPE_STRING, "hint": PROPERTY_HINT_GLOBAL_FILE}
	)
