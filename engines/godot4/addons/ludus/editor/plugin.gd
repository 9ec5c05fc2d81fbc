@tool
extends EditorPlugin
## Registers the bridge as the autoload "Ludus"; the nodes register themselves by class name.

const LudusTrainerProcess := preload("res://addons/ludus/training/trainer_process.gd")

const AUTOLOAD_NAME := "Ludus"
const BRIDGE_PATH := "res://addons/ludus/bridge/ludus_bridge.gd"


## Adds no autoload: a person who has deleted it knows why. [code]ludus addon install[/code], after
## which [method _enable_plugin] is never called, has put it into the project file.
func _enter_tree() -> void:
	_offer_python_setting()


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
