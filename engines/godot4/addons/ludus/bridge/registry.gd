extends RefCounted
## What of Ludus there is in this process: the bridge, its pace, and the agents.
##
## Static, as nodes of any scene need it, with the autoload or without. Each of them takes itself
## out when it leaves the tree; only [member watched_ticks] is a setting of the whole game.

const LudusAutoload := preload("res://addons/ludus/bridge/ludus_bridge.gd")
const LudusGamePace := preload("res://addons/ludus/training/game_pace.gd")

## The autoload; null as long as it is not in the tree.
static var bridge: LudusAutoload
## What lets the game's time pass; null as long as it is not in the tree.
static var pace: LudusGamePace
## Ticks per second while people watch, see [method LudusPace.watch_at]; 0: the project's.
static var watched_ticks: int = 0
## What shows the observations and decisions of an agent; null as long as there is none.
static var debug_view: LudusDebugView
## Agents in the tree, in the order in which they came.
static var agents: Dictionary[LudusAgent, bool] = {}
## Those of them that no batch has taken yet; false for those that found no free slot and wait.
static var newcomers: Dictionary[LudusAgent, bool] = {}
## Goes up whenever an agent comes, goes, or is to be played by something else.
static var num_changes: int = 0


## The debug view while it is shown; null otherwise.
static func shown_debug_view() -> LudusDebugView:
	return debug_view if debug_view != null and debug_view.visible else null


## Notes that an agent has entered the tree.
static func add(agent: LudusAgent) -> void:
	agents[agent] = true
	newcomers[agent] = true
	num_changes += 1


## Notes that an agent is leaving the tree.
static func remove(agent: LudusAgent) -> void:
	agents.erase(agent)
	newcomers.erase(agent)
	num_changes += 1
