extends RefCounted
## What an agent with sensors observes: what its game returns, and an entry for each sensor.

## The sensors, in the order of the tree.
var sensors: Array[Node] = []

var _names: PackedStringArray = []
var _game: Object


## Sensors of an agent whose methods are those of [param target]: all below its node, but none of
## another agent below it. Cameras count where the game has no [code]get_observation()[/code].
static func find_sensors(agent: LudusAgent, target: Object) -> Array[Node]:
	var found: Array[Node] = []
	if target is Node:
		_gather(target as Node, agent, not agent.game_observes(), found)
	return found


## All sensors of an agent, also those that are not entries, but no cameras.
static func find_all_sensors(agent: LudusAgent) -> Array[Node]:
	var found: Array[Node] = []
	if agent.target is Node:
		_gather(agent.target as Node, agent, false, found, true)
	return found


## The entry of a sensor or camera.
static func entry_of(sensor: Node) -> LudusObservationEntry:
	var entry: LudusObservationEntry
	if sensor is LudusSensor2D:
		entry = (sensor as LudusSensor2D).make_entry()
	elif sensor is LudusSensor3D:
		entry = (sensor as LudusSensor3D).make_entry()
	else:
		var channels := 3 if sensor.get(&"channels") == 0 else 1
		var shape := PackedInt32Array([sensor.get(&"height"), sensor.get(&"width"), channels])
		entry = LudusObservationEntry.create("", shape, LudusObservationEntry.DType.UINT8)
	entry.name = sensor.name
	return entry


## Says what is wrong with sensors, or returns an empty text.
static func find_mistake(found: Array[Node]) -> String:
	var names := {}
	for sensor: Node in found:
		if names.has(sensor.name):
			return "two sensors are called %s: each name is an entry" % sensor.name
		names[sensor.name] = true
		if entry_of(sensor).size() == 0:
			return "the sensor %s has no values" % sensor.name
	return ""


func _init(agent: LudusAgent, found: Array[Node]) -> void:
	sensors = found
	_game = agent.target if agent.game_observes() else null
	for sensor: Node in sensors:
		_names.append(sensor.name)


## Takes what the sensors see, beside what the game returns.
func get_observation() -> Variant:
	if _game == null and sensors.size() == 1:
		return _look(0)
	var seen := {}
	if _game != null:
		var own: Variant = _game.get_observation()
		seen = (own as Dictionary).duplicate() if own is Dictionary else {"observation": own}
	for i: int in sensors.size():
		seen[_names[i]] = _look(i)
	return seen


func _look(i: int) -> Variant:
	var sensor := sensors[i]
	return sensor.sense() if sensor.has_method(&"sense") else sensor.call(&"get_image")


static func _gather(
	node: Node, agent: LudusAgent, has_cameras: bool, found: Array[Node], has_hidden: bool = false
) -> void:
	for child: Node in node.get_children():
		if child is LudusSensor2D or child is LudusSensor3D:
			if has_hidden or child.get(&"is_entry"):
				found.append(child)
		elif has_cameras and (child is LudusCamera2D or child is LudusCamera3D):
			found.append(child)
		if not _is_another(child, agent):
			_gather(child, agent, has_cameras, found, has_hidden)


## Whether a node below that of an agent is another agent's.
static func _is_another(node: Node, agent: LudusAgent) -> bool:
	for child: Node in node.get_children():
		if child is LudusAgent and child != agent and (child as LudusAgent).target_path.is_empty():
			return true
	return false
