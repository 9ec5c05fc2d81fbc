class_name LudusPace
extends RefCounted
## How fast the game's time passes for people who watch.

const LudusRegistry := preload("res://addons/ludus/bridge/registry.gd")


## Lets a game whose step is a tick or two be slow enough to be watched: [param ticks_per_second]
## while it is played by hand or plays a round, 0 for the project's. The length of a tick stays.
static func watch_at(ticks_per_second: int) -> void:
	LudusRegistry.watched_ticks = ticks_per_second
	var pace := LudusRegistry.pace
	if pace != null and not pace.is_fast:
		pace.choose()
