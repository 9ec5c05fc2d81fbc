extends RefCounted
## Draws one world when the trainer asks for a picture of it, and at no other time.

## Larger pictures are halved: base64 of this many pixels fits into a frame (PROTOCOL.md §1).
const MAX_PIXELS := 3_000_000


## Returns why nothing can be drawn, or an empty text.
static func find_problem(world: LudusWorld) -> String:
	if DisplayServer.get_name() == "headless":
		return "this engine runs without a renderer"
	if not world.is_drawn:
		return "the game was started without --ludus-pictures, so that this world is not drawn"
	return ""


## Returns what [param world] looks like: [code]width[/code], [code]height[/code] and
## [code]rgb[/code], base64 of three bytes a pixel. It is as large as the project's window.
## [param others] share its space, and are not seen.
static func of(world: LudusWorld, others: Array[LudusWorld]) -> Dictionary:
	var viewport := world.root.get_viewport()
	_prepare(viewport as SubViewport)
	var seen := viewport.canvas_transform
	_aim(viewport, world)
	var hidden := _hide(others)
	# Nodes that were moved in this tick tell the renderer only at its end, unless they are asked to.
	world.root.propagate_call(&"force_update_transform")
	# A picture for the trainer is no frame of the game; who waits for those shall not hear of it.
	RenderingServer.set_block_signals(true)
	RenderingServer.force_draw(false)
	RenderingServer.set_block_signals(false)
	for node: Node in hidden:
		node.set(&"visible", true)
	viewport.canvas_transform = seen
	var image := viewport.get_texture().get_image()
	image.convert(Image.FORMAT_RGB8)
	while image.get_width() * image.get_height() > MAX_PIXELS:
		image.shrink_x2()
	return {
		"width": image.get_width(),
		"height": image.get_height(),
		"rgb": Marshalls.raw_to_base64(image.get_data()),
	}


## Has the space of a world drawn with the next frame, unless the window shows it anyway.
static func _prepare(space: SubViewport) -> void:
	if space == null or space.get_parent() is SubViewportContainer:
		return
	space.disable_3d = false
	space.size = Vector2i(
		int(ProjectSettings.get_setting("display/window/size/viewport_width")),
		int(ProjectSettings.get_setting("display/window/size/viewport_height"))
	)
	space.render_target_update_mode = SubViewport.UPDATE_ONCE


## Looks through the world's own camera, or at its place among the worlds that share its space.
static func _aim(viewport: Viewport, world: LudusWorld) -> void:
	for camera: Node in world.root.find_children("*", "Camera3D", true, false):
		if camera is not LudusCamera3D:
			(camera as Camera3D).make_current()
			return
	var cameras := world.root.find_children("*", "Camera2D", true, false)
	if not cameras.is_empty():
		(cameras[0] as Camera2D).make_current()
		(cameras[0] as Camera2D).force_update_scroll()
		return
	# The camera of another world may look: it was moved, too.
	var offset := world.grid_offset
	if viewport.get_camera_2d() != null:
		offset -= LudusWorld.find_above(viewport.get_camera_2d()).grid_offset
	viewport.canvas_transform = viewport.canvas_transform.translated_local(-offset)


## Hides the worlds that share the space of the one to be drawn; returns what was visible.
static func _hide(worlds: Array[LudusWorld]) -> Array[Node]:
	var hidden: Array[Node] = []
	for world: LudusWorld in worlds:
		var layers := world.root.find_children("*", "CanvasLayer", true, false)
		for node: Node in [world.root] + layers:
			if node.get(&"visible") == true:
				node.set(&"visible", false)
				hidden.append(node)
	return hidden
