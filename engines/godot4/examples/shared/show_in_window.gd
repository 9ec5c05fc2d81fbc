extends Node
## Loads what draws the scene above it if this world is drawn. Put it into a scene whose root has no
## script of its own; see [code]in_window.gd[/code].

const InWindow := preload("res://examples/shared/in_window.gd")

## Ticks per second while somebody watches, for games whose step is one tick; 0 leaves it alone.
@export var watched_ticks_per_second: int = 0


func _ready() -> void:
	if LudusWorld.of(self).is_drawn:
		# The parent is still busy with its children.
		_show.call_deferred()


func _exit_tree() -> void:
	if watched_ticks_per_second > 0:
		LudusPace.watch_at(0)


func _show() -> void:
	if watched_ticks_per_second > 0:
		LudusPace.watch_at(watched_ticks_per_second)
	InWindow.show(get_parent())
