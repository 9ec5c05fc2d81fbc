class_name LudusStage
extends Node
## Makes copies of a scene and keeps them apart (ARCHITECTURE.md, world cloning).

## Bullet counts active spaces in eight bits, and steps none of them when there are more than 127;
## one is the root's.
const MAX_BULLET_SPACES := 126
const PHYSICS_SETTING := "physics/3d/physics_engine"
const GODOT_PHYSICS := "GodotPhysics"

## The worlds, in order.
var worlds: Array = []
## The layout in use.
var layout: int = LudusWorld.Layout.ISOLATED
## Why [method build] failed.
var error: String = ""
## The scene that the worlds are copies of.
var scene: PackedScene
## How many worlds are drawn, where there is a window. Of worlds in a 3D grid it is the first.
var num_drawn: int = 1

var _spaces: Array = []
var _views: LudusViews
var _num_worlds: int = 1
var _first_world: int = 0
var _layout_name: String = "scene"
## Whether the scene has anything in three dimensions.
var _is_3d: bool = true
## Whether there is a window to show worlds in. Cameras of agents draw without one.
var _has_window: bool = not OS.has_feature("Server") and VisualServer.render_loop_enabled
## Worlds that are drawn.
var _num_views: int = 0


## Worlds stop when the tree is paused, unlike the bridge above them.
func _init() -> void:
	pause_mode = Node.PAUSE_MODE_STOP


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
	var parameters := []
	for world in worlds:
		parameters.append(world.parameters)
	clear()
	_num_views = int(min(num_drawn, _num_worlds)) if _has_window else 0
	for i in _num_worlds:
		var root := scene.instance()
		var world := _prepare(root, i)
		if i < parameters.size():
			world.parameters = parameters[i]
		if i == 0 and not _choose_layout(world, root):
			root.free()
			return false
		if i == 0 or layout == LudusWorld.Layout.ISOLATED:
			_spaces.append(_add_space(world.is_drawn))
		world.layout = layout
		if layout == LudusWorld.Layout.GRID:
			_place(root, i, worlds[0].distance_between_copies())
		_spaces[-1].add_child(root)
		if i > 0 and world.is_drawn and layout == LudusWorld.Layout.GRID:
			_views.look_at_world(world, worlds[0])
	call_deferred("_show_first")
	return true


## Makes one world anew at its place and returns it. Seed, episode and parameters are kept.
func rebuild_world(i: int) -> LudusWorld:
	var old: LudusWorld = worlds[i]
	var space: Viewport = _spaces[i if layout == LudusWorld.Layout.ISOLATED else 0]
	var root := scene.instance()
	var world := _prepare(root, i)
	world.take_over(old)
	worlds.pop_back()
	worlds[i] = world
	world.layout = layout
	if layout == LudusWorld.Layout.GRID:
		_place(root, i, world.distance_between_copies())
	old.root.free()
	space.add_child(root)
	return world


## Removes all worlds.
func clear() -> void:
	worlds.clear()
	_spaces.clear()
	_views = null
	for child in get_children():
		remove_child(child)
		child.free()


## Stops the physics of all worlds but some, or lets all go on. Only the isolated layout can.
func set_running(running: Array) -> void:
	var all := running.empty()
	get_tree().paused = not all
	Physics2DServer.set_active(true)
	PhysicsServer.set_active(true)
	for world in worlds:
		var runs: bool = all or world in running
		var viewport: Viewport = world.root.get_viewport()
		Physics2DServer.space_set_active(viewport.world_2d.space, runs)
		PhysicsServer.space_set_active(_space_of(world), runs)
		world.root.pause_mode = (
			Node.PAUSE_MODE_PROCESS
			if runs and not all
			else Node.PAUSE_MODE_INHERIT
		)


## Lets the bodies of worlds that were made anew tick once, while everything else is paused: Bullet
## gives a body its gravity only after its first tick. Worlds that share a space with others cannot.
func warm_up(fresh: Array) -> void:
	var is_shared: bool = layout == LudusWorld.Layout.GRID
	if not _is_3d or not _has_bullet() or (is_shared and fresh.size() < worlds.size()):
		return
	PhysicsServer.set_active(true)
	for world in worlds:
		PhysicsServer.space_set_active(_space_of(world), is_shared or world in fresh)


## Lets the physics of all worlds go on.
func end_warm_up() -> void:
	if _is_3d:
		for world in worlds:
			PhysicsServer.space_set_active(_space_of(world), true)


func _space_of(world: LudusWorld) -> RID:
	return world.root.get_viewport().find_world().space


func _prepare(root: Node, i: int) -> LudusWorld:
	var world: LudusWorld = LudusWorld.find_in(root)
	if world == null:
		world = LudusWorld.new()
		root.add_child(world)
	world.attach(root)
	world.index = _first_world + i
	world.is_drawn = i < _num_views
	worlds.append(world)
	return world


func _choose_layout(world: LudusWorld, root: Node) -> bool:
	layout = world.layout
	if _layout_name != "scene":
		layout = LudusWorld.Layout.GRID if _layout_name == "grid" else LudusWorld.Layout.ISOLATED
	_is_3d = _has_spatial(root)
	if layout == LudusWorld.Layout.ISOLATED:
		if _is_3d and _num_worlds > MAX_BULLET_SPACES and _has_bullet():
			error = (
				"%d isolated 3D worlds: Bullet can keep %d; take more engines, the grid or %s=%s"
				% [_num_worlds, MAX_BULLET_SPACES, PHYSICS_SETTING, GODOT_PHYSICS]
			)
		return error.empty()
	if root is Spatial:
		_num_views = int(min(_num_views, 1))
	if not root is Node2D and not root is Spatial:
		error = "the grid needs a root that is a Node2D or Spatial, not %s" % root.get_class()
	elif world.settle_ticks > 0:
		error = "settle_ticks needs the isolated layout: in the grid no world can tick alone"
	elif _num_worlds > 1 and _axes(root, world.distance_between_copies()).empty():
		error = "the grid needs LudusWorld.spacing, larger than anything in a world reaches"
	return error.empty()


func _has_bullet() -> bool:
	return str(ProjectSettings.get_setting(PHYSICS_SETTING)) != GODOT_PHYSICS


func _has_spatial(node: Node) -> bool:
	if node is Spatial:
		return true
	for child in node.get_children():
		if _has_spatial(child):
			return true
	return false


## Each space is a viewport with its own 2D world and, if the scene needs it, its own 3D world (4 MB
## in Bullet).
func _add_space(is_seen: bool) -> Viewport:
	var viewport := _add_seen_space() if is_seen else _add_hidden_space()
	viewport.own_world = _is_3d
	return viewport


func _add_hidden_space() -> Viewport:
	var viewport := Viewport.new()
	viewport.size = Vector2(2.0, 2.0)
	viewport.render_target_update_mode = Viewport.UPDATE_DISABLED
	add_child(viewport)
	return viewport


func _add_seen_space() -> Viewport:
	if _views == null:
		_views = LudusViews.new(_num_views)
		add_child(_views)
	var viewport := _views.add_view()
	viewport.render_target_update_mode = Viewport.UPDATE_WHEN_VISIBLE
	viewport.msaa = get_viewport().msaa
	return viewport


## All copies in a grid bring a camera; the first world's is the one to look through.
func _show_first() -> void:
	for world in worlds:
		if world.is_drawn and (layout != LudusWorld.Layout.GRID or world == worlds[0]):
			_make_cameras_current(world.root)


func _make_cameras_current(node: Node) -> void:
	if node is Camera and not node is LudusCamera3D:
		(node as Camera).make_current()
	elif node is Camera2D:
		(node as Camera2D).make_current()
	for child in node.get_children():
		_make_cameras_current(child)


## Copies lie in a block around the origin, where floats are most precise.
func _place(root: Node, i: int, spacing: Vector3) -> void:
	var axes := _axes(root, spacing)
	if axes.empty():
		return
	var side := int(ceil(pow(_num_worlds, 1.0 / axes.size()) - 1e-9))
	var place := Vector3.ZERO
	var rest := i
	for axis in axes:
		place[axis] = (rest % side - (side - 1) / 2) * spacing[axis]
		rest /= side
	if root is Node2D:
		(root as Node2D).position += Vector2(place.x, place.y)
	else:
		(root as Spatial).translation += place


## The axes along which copies are put.
static func _axes(root: Node, spacing: Vector3) -> PoolIntArray:
	var axes := PoolIntArray()
	for axis in 2 if root is Node2D else 3:
		if spacing[axis] > 0.0:
			axes.append(axis)
	return axes
