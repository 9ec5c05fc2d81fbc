class_name LudusCameras
extends Reference
## All [LudusCamera3D] and [LudusCamera2D] of all worlds: they are drawn together, when one is asked
## for its picture and at most once a step.
##
## Each picture is read back by itself. To put them side by side and read them back in one piece was
## measured: it is half as fast in Godot 4 and as fast in Godot 3, by software OpenGL.

## What to do where there is no renderer.
const HINT := (
	"ludus engine install godot3 --rendering; where there is no screen, also Xvfb "
	+ "(Debian: apt install xvfb xauth)"
)
## Godot 3 has no static variables; what a constant dictionary holds is shared all the same.
const _SHARED := {"views": [], "scenarios": null, "has_warned": false}


## Whether this engine can draw at all.
static func has_renderer() -> bool:
	return not OS.has_feature("Server")


## Whether there is any camera.
static func are_used() -> bool:
	return not _SHARED["views"].empty()


## Takes in a camera that has entered the scene, and returns its view.
static func add(camera: Node) -> LudusCameraView:
	var view := LudusCameraView.new(camera)
	_SHARED["views"].append(view)
	return view


## Forgets the view of a camera that leaves the scene.
static func remove(view: LudusCameraView) -> void:
	_SHARED["views"].erase(view)
	view.close()
	var scenarios: LudusCameraScenarios = _SHARED["scenarios"]
	if scenarios != null and not _has_view_of(view.world):
		scenarios.close(view.world)
	if not are_used():
		_SHARED["scenarios"] = null


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
	for view in _SHARED["views"]:
		is_any = view.take_beginning() or is_any
	return is_any and has_renderer()


## Lets all cameras look again.
static func refresh() -> void:
	for view in _SHARED["views"]:
		view.forget()


## Returns why pictures cannot be drawn, naming a camera, or an empty text.
static func find_problem() -> String:
	if has_renderer() or not are_used():
		return ""
	var view: LudusCameraView = _SHARED["views"][0]
	return "camera %s needs a renderer, and this engine runs without one" % view.path_in_world()


static func _draw() -> void:
	var roots := {}
	for view in _SHARED["views"]:
		if view.is_stale():
			roots[view.root()] = true
	# Nodes that were moved in this tick tell the renderer only at its end, unless they are asked to.
	for root in roots:
		root.propagate_call("force_update_transform")
	for view in _SHARED["views"]:
		if view.is_stale():
			view.prepare(_scenario_of(view))
	# A picture for an agent is no frame of the game; who waits for those shall not hear of it.
	VisualServer.set_block_signals(true)
	VisualServer.force_draw(false)
	VisualServer.set_block_signals(false)


static func _scenario_of(view: LudusCameraView) -> RID:
	if _SHARED["scenarios"] == null:
		_SHARED["scenarios"] = LudusCameraScenarios.new()
	return _SHARED["scenarios"].scenario_of(view.camera, view.world)


static func _has_view_of(world: LudusWorld) -> bool:
	for view in _SHARED["views"]:
		if view.world == world:
			return true
	return false


static func _warn_once() -> void:
	if not _SHARED["has_warned"]:
		_SHARED["has_warned"] = true
		push_warning("ludus: %s" % find_problem())
