extends Reference
## Loads what is only there to be looked at.
##
## Everything that draws an example is marked "Load As Placeholder" in its scene: the editor shows
## it, the running game leaves it out until [method show] asks for it. So thousands of headless
## copies carry no meshes, lights or labels.

## Placeholders of this name hold camera, light and text: one in each viewport is enough.
const STAGE_NAME := "Stage"


## Loads the placeholders under [param world], if there is a window.
static func show(world: Node) -> void:
	if OS.has_feature("Server"):
		return
	for child in world.get_children():
		show(child)
		if not child is InstancePlaceholder:
			continue
		if child.name != STAGE_NAME or not _has_camera(world.get_viewport()):
			child.create_instance(true)


static func _has_camera(viewport: Viewport) -> bool:
	return viewport.get_camera() != null
