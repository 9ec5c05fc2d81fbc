extends Node
## Makes copies of a scene and keeps them apart (ARCHITECTURE.md, world cloning).

const LudusExtent := preload("res://addons/ludus/world/extent.gd")
const LudusViews := preload("res://addons/ludus/world/views.gd")

## The worlds, in order.
var worlds: Array[LudusWorld] = []
## The layout in use.
var layout: LudusWorld.Layout = LudusWorld.Layout.ISOLATED
## Why [method build] failed, or what went wrong while worlds settled; else empty.
var error: String = ""
## The scene that the worlds are copies of.
var scene: PackedScene
## How many worlds are drawn, where there is a window. Of worlds in a 3D grid it is the first.
var visible_worlds: int = 1
## Whether all worlds look as if they were drawn, for pictures that the trainer may ask for.
var has_pictures: bool = false

## Between copies in the grid.
var _distance := Vector3.ZERO
var _spaces: Array[SubViewport] = []
var _views: LudusViews
var _num_worlds: int = 1
var _first_world: int = 0
var _layout_name: String = "scene"
## Worlds that are drawn.
var _num_views: int = 0
## Worlds that tick alone until they can be observed, and for how long they have.
var _settling: Array[LudusWorld] = []
var _num_settle_ticks: int = 0


## Worlds stop when the tree is paused, unlike the bridge above them.
func _init() -> void:
	process_mode = Node.PROCESS_MODE_PAUSABLE


## Chooses what [method build] makes: [param num_worlds] copies of [param world_scene], numbered
## from [param first_world]; [param layout_name] is [code]scene[/code], [code]isolated[/code] or
## [code]grid[/code].
func configure(
	world_scene: PackedScene, num_worlds: int, first_world: int, layout_name: String
) -> void:
	scene = world_scene
	_num_worlds = num_worlds
	_first_world = first_world
	_layout_name = layout_name


## Makes all worlds anew, in fresh physics spaces. Returns false and sets [member error] if the
## scene does not fit the layout. Parameters of the worlds are kept.
func build() -> bool:
	var parameters: Array[Dictionary] = []
	for world: LudusWorld in worlds:
		parameters.append(world.parameters)
	clear()
	_num_views = mini(visible_worlds, _num_worlds) if _has_window() else 0
	for i: int in _num_worlds:
		var root := scene.instantiate()
		var world := _prepare(root, i)
		if i < parameters.size():
			world.parameters = parameters[i]
		if i == 0 and not _choose_layout(world, root):
			root.free()
			return false
		if i == 0 or layout == LudusWorld.Layout.ISOLATED:
			_spaces.append(_add_space(i < _num_views))
		world.layout = layout
		if layout == LudusWorld.Layout.GRID:
			_place(root, i, _distance)
		_spaces[-1].add_child(root)
		if i > 0 and i < _num_views and layout == LudusWorld.Layout.GRID:
			_views.look_at_world(world, worlds[0])
	# Deferred: inside a tick Godot takes a new camera at the address of one that was just freed for
	# that one, and does not make it current.
	_show_first.call_deferred()
	return true


## The number of a world here, or -1 if it is none of these.
func find(world: LudusWorld) -> int:
	var i := world.index - _first_world if world != null else -1
	return i if i >= 0 and i < worlds.size() and worlds[i] == world else -1


## Makes one world anew at its place and returns it. Seed, episode and parameters are kept.
func rebuild_world(i: int) -> LudusWorld:
	var old := worlds[i]
	var space := _spaces[i if layout == LudusWorld.Layout.ISOLATED else 0]
	var root := scene.instantiate()
	var world := _prepare(root, i)
	world.take_over(old)
	worlds.pop_back()
	worlds[i] = world
	world.layout = layout
	if layout == LudusWorld.Layout.GRID:
		_place(root, i, _distance)
	old.root.free()
	space.add_child(root)
	return world


## Removes all worlds.
func clear() -> void:
	worlds.clear()
	_spaces.clear()
	_views = null
	for child: Node in get_children():
		remove_child(child)
		child.free()


## Lets only some worlds tick until they can be observed: for their
## [member LudusWorld.settle_ticks], and until their simulation has begun.
func begin_settling(settling: Array[LudusWorld]) -> void:
	_settling = settling
	_num_settle_ticks = 0
	_set_running(_settling)


## Notes that a tick has passed. Returns whether all worlds can be observed; then everything goes
## on. Sets [member error] if that will never be.
func advance_settling() -> bool:
	_num_settle_ticks += 1
	_check_sharing()
	var rest := _settling.filter(_is_settling)
	if rest.is_empty():
		_set_running([])
		return true
	if rest.size() < _settling.size():
		_settling.assign(rest)
		_check_sharing()
		_set_running(_settling)
	_check_limit()
	return false


## Returns what worlds are made of when a trainer asks for [param asked], and puts that on show,
## once, if it is a viewer scene; there it stays when worlds are made anew.
static func show_viewer(asked: PackedScene, tree: SceneTree) -> PackedScene:
	if not is_viewer(asked):
		return asked
	var root := asked.instantiate()
	tree.root.add_child(root)
	tree.current_scene = root
	return root.call(LudusWorld.VIEWER_METHOD)


## Whether the root of a scene names another one that worlds are made of.
static func is_viewer(asked: PackedScene) -> bool:
	var script := _root_script(asked)
	if script == null:
		return false
	for method: Dictionary in script.get_script_method_list():
		if method["name"] == LudusWorld.VIEWER_METHOD:
			return true
	return false


## Stops the physics of all worlds but some, or lets all go on. Only the isolated layout can.
func _set_running(running: Array[LudusWorld]) -> void:
	var all := running.is_empty()
	get_tree().paused = not all
	PhysicsServer2D.set_active(true)
	PhysicsServer3D.set_active(true)
	for world: LudusWorld in worlds:
		var runs := all or world in running
		if world.root is LudusSimulationHost:
			(world.root as LudusSimulationHost).set_running(runs, not all)
		else:
			var viewport := world.root.get_viewport()
			PhysicsServer2D.space_set_active(viewport.world_2d.space, runs)
			PhysicsServer3D.space_set_active(viewport.find_world_3d().space, runs)
		world.root.process_mode = (
			Node.PROCESS_MODE_ALWAYS if runs and not all else Node.PROCESS_MODE_INHERIT
		)


## The script of the root, which may come from the scene that this one inherits.
static func _root_script(asked: PackedScene) -> Script:
	var state := asked.get_state()
	for i: int in state.get_node_property_count(0):
		if state.get_node_property_name(0, i) == &"script":
			return state.get_node_property_value(0, i) as Script
	var inherited := state.get_node_instance(0)
	return _root_script(inherited) if inherited != null else null


func _is_settling(world: LudusWorld) -> bool:
	return not world.is_ready or _num_settle_ticks < world.settle_ticks


## Physics of a space that worlds share cannot tick for some of them only.
func _check_sharing() -> void:
	if _settling.size() == worlds.size():
		return
	for world: LudusWorld in _settling:
		var host := world.root as LudusSimulationHost
		if host != null and host.is_sharing() and error.is_empty():
			error = (
				"world %d: %s awaits ticks to begin: in the grid no world can tick alone"
				% [find(world), host.simulation.describe()]
			)


func _check_limit() -> void:
	for world: LudusWorld in _settling:
		var host := world.root as LudusSimulationHost
		if host == null or world.is_ready or not error.is_empty():
			continue
		var limit := host.simulation.max_begin_ticks()
		if _num_settle_ticks >= limit:
			error = (
				"world %d: %s: create() and begin_episode() are not over after %d ticks"
				% [find(world), host.simulation.describe(), limit]
			)


## Cameras of agents draw without one.
static func _has_window() -> bool:
	return DisplayServer.get_name() != "headless" and RenderingServer.render_loop_enabled


func _prepare(root: Node, i: int) -> LudusWorld:
	var world := LudusWorld.find_in(root)
	if world == null:
		world = LudusWorld.new()
		root.add_child(world, false, Node.INTERNAL_MODE_BACK)
	world.attach(root)
	world.index = _first_world + i
	world.is_drawn = i < _num_views or has_pictures
	worlds.append(world)
	return world


func _choose_layout(world: LudusWorld, root: Node) -> bool:
	layout = world.layout
	if _layout_name != "scene":
		layout = (LudusWorld.Layout.GRID if _layout_name == "grid" else LudusWorld.Layout.ISOLATED)
	if layout == LudusWorld.Layout.ISOLATED:
		return true
	if root is Node3D:
		_num_views = mini(_num_views, 1)
	if root is not Node2D and root is not Node3D:
		error = "the grid needs a scene whose root is a Node2D or Node3D, not %s" % root.get_class()
	elif world.settle_ticks > 0:
		error = "settle_ticks needs the isolated layout: in the grid no world can tick alone"
	elif _num_worlds > 1:
		_choose_distance(world, root)
	return error.is_empty()


## Copies must not lie in each other. Half of a scene may: it is walls that overlap, most often.
func _choose_distance(world: LudusWorld, root: Node) -> void:
	_distance = world.distance_between_copies()
	if _axes(root, _distance).is_empty():
		error = "the grid needs LudusWorld.spacing, larger than anything in a world reaches"
		return
	var extent := LudusExtent.of(root)
	for axis: int in _axes(root, _distance):
		if _distance[axis] >= extent[axis] / 2.0:
			continue
		if world.spacing.is_zero_approx():
			_distance[axis] = nearest_po2(ceili(extent[axis]))
		else:
			var needed := Vector3(nearest_po2(ceili(extent.x)), nearest_po2(ceili(extent.y)), 0.0)
			error = (
				"copies lie in each other in the grid: the scene's collision shapes reach over "
				+ (
					"%d × %d pixels, but LudusWorld.spacing is %s; set it to %s"
					% [extent.x, extent.y, world.spacing, needed]
				)
			)
			return


## Each space is a viewport with its own 2D and 3D worlds.
func _add_space(is_seen: bool) -> SubViewport:
	if is_seen:
		return _add_seen_space()
	var viewport := SubViewport.new()
	viewport.own_world_3d = true
	viewport.size = Vector2i(2, 2)
	viewport.render_target_update_mode = SubViewport.UPDATE_DISABLED
	viewport.disable_3d = _num_views == 0 and not has_pictures
	add_child(viewport)
	return viewport


func _add_seen_space() -> SubViewport:
	if _views == null:
		_views = LudusViews.new(_num_views)
		add_child(_views)
	var viewport := _views.add_view()
	viewport.own_world_3d = true
	viewport.render_target_update_mode = SubViewport.UPDATE_WHEN_VISIBLE
	viewport.msaa_3d = get_viewport().msaa_3d
	return viewport


## All copies in a grid bring a camera; the first world's is the one to look through.
func _show_first() -> void:
	for world: LudusWorld in worlds:
		if not world.is_drawn or (layout == LudusWorld.Layout.GRID and world != worlds[0]):
			continue
		for camera: Node in world.root.find_children("*", "Camera3D", true, false):
			if camera is not LudusCamera3D:
				(camera as Camera3D).make_current()
		for camera: Node in world.root.find_children("*", "Camera2D", true, false):
			(camera as Camera2D).make_current()


## Copies lie in a block around the origin, where floats are most precise.
func _place(root: Node, i: int, spacing: Vector3) -> void:
	var axes := _axes(root, spacing)
	if axes.is_empty():
		return
	var side := ceili(pow(_num_worlds, 1.0 / axes.size()) - 1e-9)
	var place := Vector3.ZERO
	var rest := i
	for axis: int in axes:
		place[axis] = (rest % side - (side - 1) / 2) * spacing[axis]
		rest /= side
	if root is LudusSimulationHost:
		(root as LudusSimulationHost).place(place)
	elif root is Node2D:
		LudusWorld.find_in(root).grid_offset = Vector2(place.x, place.y)
		(root as Node2D).position += Vector2(place.x, place.y)
	else:
		(root as Node3D).position += place


## The axes along which copies are put.
static func _axes(root: Node, spacing: Vector3) -> PackedInt32Array:
	var axes := PackedInt32Array()
	for axis: int in 2 if root is Node2D and root is not LudusSimulationHost else 3:
		if spacing[axis] > 0.0:
			axes.append(axis)
	return axes
