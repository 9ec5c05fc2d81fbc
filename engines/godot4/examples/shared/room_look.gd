extends RefCounted
## Draws what [code]walled_map.gd[/code] and [code]walker.gd[/code] describe, on any canvas.

const Map := preload("res://examples/shared/walled_map.gd")
const Walker := preload("res://examples/shared/walker.gd")

const FLOOR_COLOR := Color(0.085, 0.1, 0.16)
const LINE_COLOR := Color(0.11, 0.135, 0.215)
const WALL_COLOR := Color(0.3, 0.38, 0.6)
const EDGE_COLOR := Color(0.5, 0.62, 0.95)
const INK_COLOR := Color(0.08, 0.1, 0.16)
const SHADOW_COLOR := Color(0.0, 0.0, 0.0, 0.4)
const LINE_PITCH := 50.0
## How thick the outer walls look, pixels.
const OUTER_WALL := 12.0


## Draws floor and walls.
static func draw_room(canvas: CanvasItem, map: Map) -> void:
	var half := Map.RADIUS
	var inside := Rect2(-half, -half, 2.0 * half, 2.0 * half)
	canvas.draw_rect(inside.grow(OUTER_WALL), WALL_COLOR)
	canvas.draw_rect(inside, FLOOR_COLOR)
	for i: int in range(1, int(2.0 * half / LINE_PITCH)):
		var at := -half + i * LINE_PITCH
		canvas.draw_line(Vector2(at, -half), Vector2(at, half), LINE_COLOR, 1.5)
		canvas.draw_line(Vector2(-half, at), Vector2(half, at), LINE_COLOR, 1.5)
	canvas.draw_rect(inside, EDGE_COLOR, false, 1.5)
	for i: int in range(0, map.ends.size(), 2):
		var shift := Vector2(0.0, 4.0)
		_draw_wall(canvas, map.ends[i] + shift, map.ends[i + 1] + shift, SHADOW_COLOR, 3.0)
		_draw_wall(canvas, map.ends[i], map.ends[i + 1], EDGE_COLOR, 0.0)


## Draws rays from [param place]: faint to where they end at walls, brighter to [param hits], shares
## of [constant Walker.SIGHT], where they are less than 1.
static func draw_rays(
	canvas: CanvasItem, walker: Walker, place: Vector2, hits: PackedFloat32Array, color: Color
) -> void:
	for i: int in walker.rays.size():
		var is_hit := hits[i] < 1.0
		var length := walker.ray_lengths[i]
		if is_hit:
			length = maxf(hits[i] * Walker.SIGHT, 1.0)
		var end := walker.place + walker.rays[i] * length
		canvas.draw_line(
			place, end, Color(color, 0.75 if is_hit else 0.17), 2.0 if is_hit else 1.2, true
		)
		canvas.draw_circle(
			end, 3.5 if is_hit else 1.8, Color(color, 0.9 if is_hit else 0.4), true, -1.0, true
		)


## Draws a round body with a nose that shows where it looks, and eyes.
static func draw_body(canvas: CanvasItem, place: Vector2, rotation: float, color: Color) -> void:
	var radius := Walker.RADIUS
	var way := Vector2.from_angle(rotation)
	var across := way.orthogonal()
	canvas.draw_circle(place + Vector2(0.0, 4.0), radius, SHADOW_COLOR, true, -1.0, true)
	var nose := PackedVector2Array(
		[
			place + way * radius * 1.42,
			place + way * radius * 0.72 + across * radius * 0.6,
			place + way * radius * 0.72 - across * radius * 0.6,
		]
	)
	canvas.draw_colored_polygon(nose, color.lightened(0.35))
	canvas.draw_circle(place, radius, color, true, -1.0, true)
	canvas.draw_arc(place, radius - 1.0, 0.0, TAU, 48, color.lightened(0.35), 2.0, true)
	for side: float in [-0.42, 0.42]:
		var eye := place + (way * 0.4 + across * side) * radius
		canvas.draw_circle(eye, radius * 0.24, Color.WHITE, true, -1.0, true)
		canvas.draw_circle(eye + way * radius * 0.08, radius * 0.13, INK_COLOR, true, -1.0, true)


static func _draw_wall(
	canvas: CanvasItem, from: Vector2, to: Vector2, color: Color, extra: float
) -> void:
	var width := Map.THICKNESS + extra
	canvas.draw_line(from, to, color, width, true)
	canvas.draw_circle(from, width / 2.0, color, true, -1.0, true)
	canvas.draw_circle(to, width / 2.0, color, true, -1.0, true)
