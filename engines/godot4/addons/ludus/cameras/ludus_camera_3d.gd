@tool
@icon("res://addons/ludus/icons/ludus_camera_3d.svg")
class_name LudusCamera3D
extends Camera3D
## An eye of an agent: gives what it sees as pixels, for an entry of an observation.
##
## Put it where the eye is; it looks along -z, as any [Camera3D] does. It shows nothing on the
## screen unless it is the only camera. Pixels need an engine that draws: Ludus starts one by
## itself; where there is none, [code]ludus engine install godot4 --rendering[/code] brings it.
##
## [codeblock]
## func get_observation() -> Dictionary:
##     return {"eye": $Eye.get_image()}
## [/codeblock]

## What a pixel holds: red, green and blue; or brightness alone.
enum Channels { RGB, GREY }

const LudusCameraView := preload("res://addons/ludus/cameras/camera_view.gd")
const LudusCameras := preload("res://addons/ludus/cameras/cameras.gd")

## Pixels in a row.
@export_range(1, 4096) var width: int = 84
## Rows of pixels.
@export_range(1, 4096) var height: int = 84
## What a pixel holds.
@export var channels: LudusCamera3D.Channels = Channels.RGB

var _view: LudusCameraView


func _enter_tree() -> void:
	if not Engine.is_editor_hint():
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
func get_pixels() -> PackedByteArray:
	return get_image().get_data()


## Lets all cameras look again. That is needed only where something has moved since they were asked
## last, and neither has a tick passed nor an episode begun.
func refresh() -> void:
	LudusCameras.refresh()


## Lets a viewport of the [RenderingServer] see what this camera sees.
func connect_viewport(viewport: RID, scenario: RID) -> void:
	RenderingServer.viewport_set_disable_2d(viewport, true)
	RenderingServer.viewport_set_scenario(viewport, scenario)
	RenderingServer.viewport_attach_camera(viewport, get_camera_rid())


## Prepares the next picture. The [RenderingServer] knows already where a [Camera3D] is.
func aim_viewport(_viewport: RID) -> void:
	pass
