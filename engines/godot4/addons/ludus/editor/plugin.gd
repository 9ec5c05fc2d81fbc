@tool
extends EditorPlugin
## Registers the bridge as the autoload "Ludus"; the nodes register themselves by class name.

const LudusTrainerProcess := preload("res://addons/ludus/training/trainer_process.gd")

const AUTOLOAD_NAME := "Ludus"
const BRIDGE_PATH := "res://addons/ludus/bridge/ludus_bridge.gd"


## A plugin that was switched on in the project file, by [code]ludus addon install[/code], never
## gets [method _enable_plugin].
func _enter_tree() -> void:
	_offer_python_setting()
	if not ProjectSettings.has_setting("autoload/" + AUTOLOAD_NAME):
		add_autoload_singleton(AUTOLOAD_NAME, BRIDGE_PATH)


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
