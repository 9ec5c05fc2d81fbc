extends RefCounted
## All [LudusCamera3D] and [LudusCamera2D] of all worlds: they are drawn together, when one is asked
## for its picture and at most once a step.
##
## Each picture is read back by itself. To put them side by side and read them back in one piece was
## measured: it is half as fast in Godot 4 and as fast in Godot 3, by software OpenGL.

const LudusCameraScenarios := preload("res://addons/ludus/cameras/camera_scenarios.gd")
const LudusCameraView := preload("res://addons/ludus/cameras/camera_view.gd")

## Group of other nodes that need a renderer, such as agents that see with another add-on's cameras.
const DRAWN_GROUP := &"ludus_drawn"
## What to do where there is no renderer.
const HINT := (
	"ludus engine install godot4 --rendering; where there is no screen, also Xvfb "
	+ "(Debian: apt install xvfb xauth)"
)

## Static, as the cameras of all worlds are drawn together. A camera is in the list while it is in
## the tree, and the scenarios go with the last one, so nothing of a scene outlives it.
static var _views: Array[LudusCameraView] = []
static var _scenarios: LudusCameraScenarios
## Whether this process was told that it cannot draw: that is so for all its scenes.
static var _has_warned: bool = false


## Whether this engine can draw at all.
static func has_renderer() -> bool:
	return DisplayServer.get_name() != "headless"


## Whether there is any camera.
static func are_used() -> bool:
	return not _views.is_empty()


## Takes in a camera that has entered the scene, and returns its view.
static func add(camera: Node) -> LudusCameraView:
	var view := LudusCameraView.new(camera)
	_views.append(view)
	return view


## Forgets the view of a camera that leaves the scene.
static func remove(view: LudusCameraView) -> void:
	_views.erase(view)
	view.close()
	if _scenarios != null and not _has_view_of(view.world):
		_scenarios.close(view.world)
	if not are_used():
		_scenarios = null


## Returns what a camera sees now.
static func image_of(view: LudusCameraView) -> Image:
	if not has_renderer():
		_warn_once()
		return view.black_image()
	if view.is_stale():
		_draw()
	return view.image()


## Returns whether episodes have begun since that was asked last. Nodes that draw themselves do so
## at the end of a tick, and cameras must wait for it.
static func take_beginnings() -> bool:
	var is_any := false
	for view: LudusCameraView in _views:
		is_any = view.take_beginning() or is_any
	return is_any and has_renderer()


## Lets all cameras look again.
static func refresh() -> void:
	for view: LudusCameraView in _views:
		view.forget()


## Returns why pictures cannot be drawn, naming a camera, or an empty text.
static func find_problem() -> String:
	if has_renderer():
		return ""
	var who := ""
	if are_used():
		who = "camera %s" % _views[0].path_in_world()
	else:
		var other := (Engine.get_main_loop() as SceneTree).get_first_node_in_group(DRAWN_GROUP)
		if other == null:
			return ""
		who = str(other.get_path())
	return "%s needs a renderer, and this engine runs without one" % who


static func _draw() -> void:
	var roots: Dictionary[Node, bool] = {}
	for view: LudusCameraView in _views:
		if view.is_stale():
			roots[view.root()] = true
	# Nodes that were moved in this tick tell the renderer only at its end, unless they are asked to.
	for root: Node in roots:
		root.propagate_call(&"force_update_transform")
	for view: LudusCameraView in _views:
		if view.is_stale():
			view.prepare(_scenario_of(view))
	draw_all()


## Draws a frame for agents alone.
static func draw_all() -> void:
	# A picture for an agent is no frame of the game; who waits for those shall not hear of it.
	RenderingServer.set_block_signals(true)
	RenderingServer.force_draw(false)
	RenderingServer.set_block_signals(false)


static func _scenario_of(view: LudusCameraView) -> RID:
	if _scenarios == null:
		_scenarios = LudusCameraScenarios.new()
	return _scenarios.scenario_of(view.camera, view.world)


static func _has_view_of(world: LudusWorld) -> bool:
	for view: LudusCameraView in _views:
		if view.world == world:
			return true
	return false


static func _warn_once() -> void:
	if not _has_warned:
		_has_warned = true
		push_warning("ludus: %s" % find_problem())
