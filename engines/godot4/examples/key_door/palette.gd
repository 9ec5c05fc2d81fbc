extends RefCounted
## How cells lie on the screen, and the colours and signs of the doors.

const Plan := preload("res://examples/key_door/plan.gd")

## Side of a cell, pixels.
const CELL := 116.0
const DOOR_COLORS: Array[Color] = [
	Color(0.36, 0.62, 1.0), Color(1.0, 0.72, 0.33), Color(0.76, 0.5, 1.0)
]
## A key whose colour no longer shows.
const HIDDEN_COLOR := Color(0.62, 0.66, 0.76)
## Dark shapes on coloured ones.
const INK_COLOR := Color(0.08, 0.1, 0.16)

## Triangle, square and diamond, about 2 wide.
static var _signs: Array[PackedVector2Array] = [
	PackedVector2Array([Vector2(0.0, -1.0), Vector2(0.95, 0.75), Vector2(-0.95, 0.75)]),
	PackedVector2Array(
		[Vector2(-0.8, -0.8), Vector2(0.8, -0.8), Vector2(0.8, 0.8), Vector2(-0.8, 0.8)]
	),
	PackedVector2Array(
		[Vector2(0.0, -1.1), Vector2(1.1, 0.0), Vector2(0.0, 1.1), Vector2(-1.1, 0.0)]
	),
]


## Returns the middle of a cell, pixels.
static func centre(cell: Vector2) -> Vector2:
	return (cell - Vector2(Plan.LAST_COLUMN, Plan.ROWS.size() - 1) / 2.0) * CELL


## Draws the sign of a door: triangle, square or diamond, [param size] pixels from its middle.
static func draw_sign(
	canvas: CanvasItem, place: Vector2, door: int, size: float, color: Color
) -> void:
	var points := Transform2D(0.0, Vector2.ONE * size, 0.0, place) * _signs[door]
	canvas.draw_colored_polygon(points, color)
