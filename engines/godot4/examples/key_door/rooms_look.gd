extends Node2D
## Draws floor, walls and doors; an opened door shines green or red for a moment.

const KeyDoor := preload("res://examples/key_door/key_door.gd")
const Palette := preload("res://examples/key_door/palette.gd")
const Plan := preload("res://examples/key_door/plan.gd")

const FLOOR_COLOR := Color(0.1, 0.12, 0.2)
const LINE_COLOR := Color(0.15, 0.18, 0.29)
const WALL_COLOR := Color(0.3, 0.38, 0.6)
const EDGE_COLOR := Color(0.5, 0.62, 0.95)
const RIGHT_COLOR := Color(0.45, 0.95, 0.6)
const WRONG_COLOR := Color(1.0, 0.3, 0.3)
## Thickness of walls and doors, pixels.
const WALL := 18.0
## From the middle of a door to its sign, pixels.
const SIGN_DISTANCE := 44.0
## How long an opened door shines, seconds.
const SHINE_S := 0.8

var _shining: int = -1
var _shine_color := RIGHT_COLOR
var _shine_left_s: float = 0.0


func _ready() -> void:
	var game := get_parent() as KeyDoor
	if game != null:
		game.door_opened.connect(_on_door_opened)


func _process(delta: float) -> void:
	if _shine_left_s > 0.0:
		_shine_left_s -= delta
		queue_redraw()


func _draw() -> void:
	for cell: Vector2i in Plan.cells():
		draw_rect(_rect(cell).grow(WALL + 2.0), EDGE_COLOR)
	for cell: Vector2i in Plan.cells():
		draw_rect(_rect(cell).grow(WALL), WALL_COLOR)
	for cell: Vector2i in Plan.cells():
		draw_rect(_rect(cell), LINE_COLOR)
		draw_rect(_rect(cell).grow(-1.5), FLOOR_COLOR)
	for cell: Vector2i in Plan.cells():
		if Plan.door_at(cell) >= 0:
			_draw_door(cell, Plan.door_at(cell))


func _draw_door(cell: Vector2i, door: int) -> void:
	var side := Vector2(Plan.DOOR_SIDES[door])
	var place := Palette.centre(cell) + side * (Palette.CELL + WALL) / 2.0
	var along := side.orthogonal().abs() * Palette.CELL * 0.86
	var size := along + side.abs() * (WALL + 8.0)
	var color := Palette.DOOR_COLORS[door]
	var shine := _shine_left_s / SHINE_S if door == _shining else 0.0
	if shine > 0.0:
		var glow := Color(_shine_color, 0.5 * shine)
		draw_rect(Rect2(place - size / 2.0, size).grow(26.0 * shine), glow)
		color = color.lerp(_shine_color, shine)
	# On the floor before it, light falls in its colour.
	draw_rect(_rect(cell).grow(-1.5), Color(color, 0.16))
	draw_rect(Rect2(place - size / 2.0, size), color)
	draw_rect(Rect2(place - size / 2.0, size), color.lightened(0.4), false, 2.0)
	Palette.draw_sign(self, place + side * SIGN_DISTANCE, door, 15.0, color)
	if shine > 0.0:
		_draw_verdict(place + side * SIGN_DISTANCE + along * 0.45, Color(_shine_color, shine))


## A tick or a cross.
func _draw_verdict(place: Vector2, color: Color) -> void:
	var strokes := PackedVector2Array(
		[place + Vector2(-14.0, 0.0), place + Vector2(-4.0, 11.0), place + Vector2(15.0, -13.0)]
	)
	if _shine_color == RIGHT_COLOR:
		draw_polyline(strokes, color, 7.0, true)
		return
	for end: Vector2 in [Vector2(12.0, 12.0), Vector2(12.0, -12.0)]:
		draw_line(place - end, place + end, color, 7.0, true)


func _on_door_opened(is_right: bool, door: int) -> void:
	_shining = door
	_shine_color = RIGHT_COLOR if is_right else WRONG_COLOR
	_shine_left_s = SHINE_S


func _rect(cell: Vector2i) -> Rect2:
	var size := Vector2.ONE * Palette.CELL
	return Rect2(Palette.centre(cell) - size / 2.0, size)
