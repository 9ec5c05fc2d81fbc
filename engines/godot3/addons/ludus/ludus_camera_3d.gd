tool
class_name LudusCamera3D, "res://addons/ludus/icons/ludus_camera_3d.svg"
extends Camera
## An eye of an agent: gives what it sees as pixels, for an entry of an observation.
##
## Put it where the eye is; it looks along -z, as any [Camera] does. It shows nothing on the screen
## unless it is the only camera. Pixels need an engine that draws: Ludus starts one by itself; where
## there is none, [code]ludus engine install godot3 --rendering[/code] brings it.
##
## [codeblock]
## func get_observation() -> Dictionary:
##     return {"eye": $Eye.get_image()}
## [/codeblock]

## What a pixel holds: red, green and blue; or brightness alone.
enum Channels { RGB, GREY }

## Pixels in a row.
export(int, 1, 4096) var width: int = 84
## Rows of pixels.
export(int, 1, 4096) var height: int = 84
## What a pixel holds.
export(Channels) var channels: int = Channels.RGB

var _view: LudusCameraView


func _enter_tree() -> void:
	if not Engine.editor_hint:
		_view = LudusCameras.add(self)


func _exit_tree() -> void:
	if _view != null:
		LudusCameras.remove(_view)
	_view = null


## Returns what the camera sees now, as an [Image] with [member height] rows of [member width]
## pixels of 3 bytes or 1. All cameras of all worlds are drawn together, at most once for each tick
## and each beginning of an episode. Without a renderer everything is black.
func get_image() -> Image:
	return LudusCameras.image_of(_view)


## Returns the pixels of [method get_image]: [code]uint8[height, width, channels][/code].
func get_pixels() -> PoolByteArray:
	return get_image().get_data()


## Lets all cameras look again. That is needed only where something has moved since they were asked
## last, and neither has a tick passed nor an episode begun.
func refresh() -> void:
	LudusCameras.refresh()


## Lets a viewport of the [VisualServer] see what this camera sees.
func connect_viewport(viewport: RID, scenario: RID) -> void:
	VisualServer.viewport_set_hide_canvas(viewport, true)
	VisualServer.viewport_set_scenario(viewport, scenario)
	VisualServer.viewport_attach_camera(viewport, get_camera_rid())


## Prepares the next picture. The [VisualServer] knows already where a [Camera] is.
func aim_viewport(_viewport: RID) -> void:
	pass
