extends RefCounted
## Stands in for an agent that left the scene without ending its episode: it is done at once, has
## no reward and observes zeros (PROTOCOL.md §7).

var _zeros: Dictionary = {}


func _init(entries: Array[LudusObservationEntry]) -> void:
	for entry: LudusObservationEntry in entries:
		var zeros := []
		zeros.resize(entry.size())
		zeros.fill(0)
		_zeros[entry.name] = zeros


## Ignores the action.
func apply_action(_action: Variant) -> void:
	pass


## Returns zeros for every entry.
func get_observation() -> Dictionary:
	return _zeros


## Returns 0.
func get_reward() -> float:
	return 0.0


## Returns true.
func is_done() -> bool:
	return true
