tool
extends EditorPlugin
## Registers the bridge as the autoload "Ludus"; the nodes register themselves by class name.

const AUTOLOAD_NAME := "Ludus"
const BRIDGE_PATH := "res://addons/ludus/ludus_bridge.gd"


## Not when the editor starts: a person who has deleted the autoload knows why.
func enable_plugin() -> void:
	add_autoload_singleton(AUTOLOAD_NAME, BRIDGE_PATH)


func disable_plugin() -> void:
	remove_autoload_singleton(AUTOLOAD_NAME)
