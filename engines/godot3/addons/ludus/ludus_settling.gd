class_name LudusSettling
extends Reference
## Lets some worlds tick alone for their [member LudusWorld.settle_ticks].

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
	var rest := []
	for world in _worlds:
		if _num_ticks < world.settle_ticks:
			rest.append(world)
	if rest.size() < _worlds.size():
		_worlds = rest
		_stage.set_running(_worlds)
	return rest.empty()
