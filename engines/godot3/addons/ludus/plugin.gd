tool
extends EditorPlugin
## Registers the bridge as the autoload "Ludus"; the nodes register themselves by class name.

const AUTOLOAD_NAME := "Ludus"
const BRIDGE_PATH := "res://addons/ludus/ludus_bridge.gd"


## A plugin that was switched on in the project file, by [code]ludus addon install[/code], never
## gets [method enable_plugin].
func _enter_tree() -> void:
	if not ProjectSettings.has_setting("autoload/" + AUTOLOAD_NAME):
		add_autoload_singleton(AUTOLOAD_NAME, BRIDGE_PATH)


func enable_plugin() -> void:
	add_autoload_singleton(AUTOLOAD_NAME, BRIDGE_PATH)


func disable_plugin() -> void:
	remove_autoload_singleton(AUTOLOAD_NAME)
