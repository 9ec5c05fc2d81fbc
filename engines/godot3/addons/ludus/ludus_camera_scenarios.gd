class_name LudusCameraScenarios
extends Reference
## Keeps what the worlds of a 3D grid look like apart: in one space each would see its neighbours.
##
## What is drawn of a world moves into a scenario of its own. Bodies, rays and areas stay where they
## are.

## By world.
var _scenarios: Dictionary = {}
## The world that is seen in the window, where there is one.
var _shown: LudusWorld


## Returns the scenario in which a camera finds its world, and nothing else.
func scenario_of(camera: Node, world: LudusWorld) -> RID:
	if not camera is Spatial:
		return RID()
	if world == null or world.layout != LudusWorld.Layout.GRID or not _is_copy(world):
		return camera.get_world().scenario
	if not _scenarios.has(world):
		_open(world, _make_scenario(camera))
	return _scenarios[world]


## Puts a world back that no camera looks at any more.
func close(world: LudusWorld) -> void:
	if not _scenarios.has(world):
		return
	_move_in(world.root, _shared_scenario(world))
	if world == _shown:
		_show_in_window(world, _shared_scenario(world))
		_shown = null
	VisualServer.free_rid(_scenarios[world])
	var _was_there := _scenarios.erase(world)
	if _scenarios.empty():
		world.root.get_tree().disconnect("node_added", self, "_on_node_added")


func _open(world: LudusWorld, scenario: RID) -> void:
	if _scenarios.empty():
		var tree := world.root.get_tree()
		if tree.connect("node_added", self, "_on_node_added") != OK:
			push_error("ludus: no signal node_added")
	if _shown == null:
		_shown = world
		_show_in_window(world, scenario)
	_scenarios[world] = scenario
	_move_in(world.root, scenario)


## A scene that runs by itself has no neighbours.
static func _is_copy(world: LudusWorld) -> bool:
	return world.root.get_viewport() != world.root.get_tree().root


static func _shared_scenario(world: LudusWorld) -> RID:
	return world.root.get_viewport().find_world().scenario


## Whoever watches sees one world.
static func _show_in_window(world: LudusWorld, scenario: RID) -> void:
	VisualServer.viewport_set_scenario(world.root.get_viewport().get_viewport_rid(), scenario)


static func _make_scenario(camera: Spatial) -> RID:
	var scenario := VisualServer.scenario_create()
	var shared := camera.get_world()
	if shared.environment != null:
		VisualServer.scenario_set_environment(scenario, shared.environment.get_rid())
	if shared.fallback_environment != null:
		VisualServer.scenario_set_fallback_environment(
			scenario, shared.fallback_environment.get_rid()
		)
	return scenario


func _move_in(node: Node, scenario: RID) -> void:
	if node is VisualInstance:
		VisualServer.instance_set_scenario((node as VisualInstance).get_instance(), scenario)
	for child in node.get_children():
		_move_in(child, scenario)


## What comes later joins its world.
func _on_node_added(node: Node) -> void:
	if not node is VisualInstance:
		return
	var world := LudusWorld.find_above(node)
	if world != null and _scenarios.has(world):
		var instance := (node as VisualInstance).get_instance()
		VisualServer.instance_set_scenario(instance, _scenarios[world])
