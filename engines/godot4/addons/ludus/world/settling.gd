extends RefCounted
## Lets some worlds tick alone until they can be observed: for their
## [member LudusWorld.settle_ticks], and until their simulation has begun.

const LudusStage := preload("res://addons/ludus/world/stage.gd")

## What went wrong, or an empty text.
var error: String = ""

var _stage: LudusStage
var _worlds: Array[LudusWorld] = []
var _num_ticks: int = 0


## Stops everything but [param worlds].
func _init(stage: LudusStage, worlds: Array[LudusWorld]) -> void:
	_stage = stage
	_worlds = worlds
	_stage.set_running(_worlds)


## Notes that a tick has passed. Returns whether all worlds can be observed; then everything goes
## on.
func advance() -> bool:
	_num_ticks += 1
	_check_sharing()
	var rest := _worlds.filter(_is_settling)
	if rest.is_empty():
		_stage.set_running([])
		return true
	if rest.size() < _worlds.size():
		_worlds.assign(rest)
		_check_sharing()
		_stage.set_running(_worlds)
	_check_limit()
	return false


func _is_settling(world: LudusWorld) -> bool:
	return not world.is_ready or _num_ticks < world.settle_ticks


## Physics of a space that worlds share cannot tick for some of them only.
func _check_sharing() -> void:
	if _worlds.size() == _stage.worlds.size():
		return
	for world: LudusWorld in _worlds:
		var host := world.root as LudusSimulationHost
		if host != null and host.is_sharing() and error.is_empty():
			error = (
				"world %d: %s awaits ticks to begin: in the grid no world can tick alone"
				% [_stage.worlds.find(world), host.simulation.describe()]
			)


func _check_limit() -> void:
	for world: LudusWorld in _worlds:
		var host := world.root as LudusSimulationHost
		if host == null or world.is_ready or not error.is_empty():
			continue
		var limit := host.simulation.max_begin_ticks()
		if _num_ticks >= limit:
			error = (
				"world %d: %s: create() and begin_episode() are not over after %d ticks"
				% [_stage.worlds.find(world), host.simulation.describe(), limit]
			)
