extends RefCounted
## Keeps what the worlds of a 3D grid look like apart: in one space each would see its neighbours.
##
## What is drawn of a world moves into a scenario of its own. Bodies, rays and areas stay where they
## are.

var _scenarios: Dictionary[LudusWorld, RID] = {}
## The world that is seen in the window, where there is one.
var _shown: LudusWorld


## Returns the scenario in which a camera finds its world, and nothing else.
func scenario_of(camera: Node, world: LudusWorld) -> RID:
	if camera is not Node3D:
		return RID()
	var shared := (camera as Node3D).get_world_3d()
	if world == null or world.layout != LudusWorld.Layout.GRID or not _is_copy(world):
		return shared.scenario
	if not _scenarios.has(world):
		_open(world, _make_scenario(shared))
	return _scenarios[world]


## Puts a world back that no camera looks at any more.
func close(world: LudusWorld) -> void:
	if not _scenarios.has(world):
		return
	_move_in(world.root, _shared_scenario(world))
	if world == _shown:
		_show_in_window(world, _shared_scenario(world))
		_shown = null
	RenderingServer.free_rid(_scenarios[world])
	_scenarios.erase(world)
	if _scenarios.is_empty():
		world.root.get_tree().node_added.disconnect(_on_node_added)


func _open(world: LudusWorld, scenario: RID) -> void:
	if _scenarios.is_empty():
		world.root.get_tree().node_added.connect(_on_node_added)
	if _shown == null:
		_shown = world
		_show_in_window(world, scenario)
	_scenarios[world] = scenario
	_move_in(world.root, scenario)


## A scene that runs by itself has no neighbours.
static func _is_copy(world: LudusWorld) -> bool:
	return world.root.get_viewport() != world.root.get_tree().root


static func _shared_scenario(world: LudusWorld) -> RID:
	return world.root.get_viewport().find_world_3d().scenario


## Whoever watches sees one world.
static func _show_in_window(world: LudusWorld, scenario: RID) -> void:
	RenderingServer.viewport_set_scenario(world.root.get_viewport().get_viewport_rid(), scenario)


static func _make_scenario(shared: World3D) -> RID:
	var scenario := RenderingServer.scenario_create()
	if shared.environment != null:
		RenderingServer.scenario_set_environment(scenario, shared.environment.get_rid())
	if shared.fallback_environment != null:
		RenderingServer.scenario_set_fallback_environment(
			scenario, shared.fallback_environment.get_rid()
		)
	if shared.camera_attributes != null:
		RenderingServer.scenario_set_camera_attributes(scenario, shared.camera_attributes.get_rid())
	return scenario


func _move_in(node: Node, scenario: RID) -> void:
	if node is VisualInstance3D:
		RenderingServer.instance_set_scenario((node as VisualInstance3D).get_instance(), scenario)
	for child: Node in node.get_children(true):
		_move_in(child, scenario)


## What comes later joins its world.
func _on_node_added(node: Node) -> void:
	if node is not VisualInstance3D:
		return
	var world := LudusWorld.find_above(node)
	if world != null and _scenarios.has(world):
		var instance := (node as VisualInstance3D).get_instance()
		RenderingServer.instance_set_scenario(instance, _scenarios[world])
