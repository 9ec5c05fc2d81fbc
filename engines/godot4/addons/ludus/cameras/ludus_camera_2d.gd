@tool
@icon("res://addons/ludus/icons/ludus_camera_2d.svg")
class_name LudusCamera2D
extends Node2D
## An eye of an agent that looks at the canvas: gives what lies around it as pixels, for an entry of
## an observation.
##
## Its place is the middle of the picture; it turns and scales with its parents. Pixels need an
## engine that draws: Ludus starts one by itself; where there is none,
## [code]ludus engine install godot4 --rendering[/code] brings it.
##
## [codeblock]
## func get_observation() -> Dictionary:
##     return {"eye": $Eye.get_image()}
## [/codeblock]

## What a pixel holds: red, green and blue; or brightness alone.
enum Channels { RGB, GREY }

const LudusCameraView := preload("res://addons/ludus/cameras/camera_view.gd")
const LudusCameras := preload("res://addons/ludus/cameras/cameras.gd")

const FRAME_COLOUR := Color(0.3, 0.8, 1.0, 0.8)

## Pixels in a row.
@export_range(1, 4096) var width: int = 84
## Rows of pixels.
@export_range(1, 4096) var height: int = 84
## What a pixel holds.
@export var channels: LudusCamera2D.Channels = Channels.RGB
## How much of the canvas is seen, in its own pixels; it is scaled to [member width] and
## [member height].
@export var seen_size: Vector2 = Vector2(336.0, 336.0):
	set(value):
		seen_size = value
		queue_redraw()

var _view: LudusCameraView


func _enter_tree() -> void:
	if not Engine.is_editor_hint():
		_view = LudusCameras.add(self)


func _exit_tree() -> void:
	if _view != null:
		LudusCameras.remove(_view)
	_view = null


func _draw() -> void:
	if Engine.is_editor_hint():
		draw_rect(Rect2(-seen_size / 2.0, seen_size), FRAME_COLOUR, false)


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
func connect_viewport(viewport: RID, _scenario: RID) -> void:
	RenderingServer.viewport_set_disable_3d(viewport, true)
	RenderingServer.viewport_attach_canvas(viewport, get_world_2d().canvas)


## Prepares the next picture.
func aim_viewport(viewport: RID) -> void:
	var size := Vector2(width, height)
	var zoom := size / seen_size
	var lens := Transform2D(Vector2(zoom.x, 0.0), Vector2(0.0, zoom.y), size / 2.0)
	RenderingServer.viewport_set_canvas_transform(
		viewport, get_world_2d().canvas, lens * global_transform.affine_inverse()
	)
