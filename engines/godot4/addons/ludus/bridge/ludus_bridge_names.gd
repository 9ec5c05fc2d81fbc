class_name LudusBridge
extends RefCounted
## Names that scripts use with the autoload [code]Ludus[/code]: [enum PolicyMode], and whether a
## trainer may have this game.
##
## The autoload itself, [code]res://addons/ludus/bridge/ludus_bridge.gd[/code], has no global class,
## as nobody is to place a second one with [b]Add Node[/b].

## How a policy takes part in training.
enum PolicyMode {
	TRAIN,  ## It learns.
	FROZEN,  ## It acts as in training, with chance, and learns nothing.
	DETERMINISTIC,  ## It takes its most probable action and learns nothing.
}

const LudusArguments := preload("res://addons/ludus/bridge/arguments.gd")

## Custom feature of an export preset whose release builds may be trained.
const TRAINABLE_FEATURE := "ludus"


## Whether a trainer has started the game, or it shall wait for one.
static func has_trainer_arguments() -> bool:
	var arguments := LudusArguments.read()
	return arguments.has_trainer() or not arguments.play_scene.is_empty()


## Whether a trainer may have this game: in the editor's engine, in debug builds, and in release
## builds with the custom feature [constant TRAINABLE_FEATURE]. Others are for players only.
static func is_trainable() -> bool:
	return OS.has_feature("editor") or OS.is_debug_build() or OS.has_feature(TRAINABLE_FEATURE)
