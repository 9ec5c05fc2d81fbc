extends RefCounted
## Loads what is only there to be looked at.
##
## Everything that draws an example is marked "Load As Placeholder" in its scene: the editor shows
## it, the running game leaves it out until [method show] asks for it. So thousands of headless
## copies carry no meshes, lights or labels.

## Placeholders of this name hold camera, light and text: one in each viewport is enough.
const STAGE_NAME := &"Stage"


## Loads the placeholders under [param world], if people see it.
static func show(world: Node) -> void:
	if not _is_drawn(world):
		return
	for placeholder: Node in world.find_children("*", "InstancePlaceholder", true, false):
		if placeholder.name != STAGE_NAME or not _has_camera(world.get_viewport()):
			(placeholder as InstancePlaceholder).create_instance(true)


static func _is_drawn(root: Node) -> bool:
	var world := LudusWorld.find_above(root)
	return world.is_drawn if world != null else DisplayServer.get_name() != "headless"


static func _has_camera(viewport: Viewport) -> bool:
	return viewport.get_camera_3d() != null or viewport.get_camera_2d() != null
