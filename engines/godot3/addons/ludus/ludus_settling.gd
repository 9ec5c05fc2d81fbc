class_name LudusSettling
extends Reference
## Lets some worlds tick alone until they can be observed: for their
## [member LudusWorld.settle_ticks], and until their simulation has begun.

## What went wrong, or an empty text.
var error: String = ""

var _stage: LudusStage
var _worlds: Array = []
var _num_ticks: int = 0


## Stops everything but [param worlds].
func _init(stage: LudusStage, worlds: Array) -> void:
	_stage = stage
	_worlds = worlds
	_stage.set_running(_worlds)


## Notes that a tick has passed. Returns whether all worlds can be observed; then everything goes
## on.
func advance() -> bool:
	_num_ticks += 1
	_check_sharing()
	_check_hosts()
	var rest := []
	for world in _worlds:
		if _is_settling(world):
			rest.append(world)
	if rest.empty():
		_stage.set_running([])
		return error.empty()
	if rest.size() < _worlds.size():
		_worlds = rest
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
	for world in _worlds:
		var host := world.root as LudusSimulationHost
		if host != null and host.is_sharing() and error.empty():
			error = (
				"world %d: %s awaits ticks to begin: in the grid no world can tick alone"
				% [world.index, host.simulation.describe()]
			)


## What went wrong while a simulation was created.
func _check_hosts() -> void:
	for world in _worlds:
		if world.root is LudusSimulationHost and error.empty():
			error = world.root.error


func _check_limit() -> void:
	for world in _worlds:
		var host := world.root as LudusSimulationHost
		if host == null or world.is_ready or not error.empty():
			continue
		var limit := host.simulation.max_begin_ticks()
		if _num_ticks >= limit:
			error = (
				"world %d: %s: create() and begin_episode() are not over after %d ticks"
				% [world.index, host.simulation.describe(), limit]
			)
