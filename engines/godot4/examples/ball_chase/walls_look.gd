extends Node2D
## Draws the floor and the walls of an arena.

const Arena := preload("res://examples/ball_chase/arena.gd")
const FLOOR_COLOR := Color(0.085, 0.1, 0.16)
const LINE_COLOR := Color(0.13, 0.16, 0.25)
const WALL_COLOR := Color(0.3, 0.38, 0.6)
const EDGE_COLOR := Color(0.5, 0.62, 0.95)
const LINE_PITCH := 40.0


func _draw() -> void:
	draw_rect(Arena.INSIDE, FLOOR_COLOR)
	var size := Arena.INSIDE.size
	for i: int in int(size.x / LINE_PITCH):
		draw_line(Vector2(i * LINE_PITCH, 0.0), Vector2(i * LINE_PITCH, size.y), LINE_COLOR, 1.0)
	for i: int in int(size.y / LINE_PITCH):
		draw_line(Vector2(0.0, i * LINE_PITCH), Vector2(size.x, i * LINE_PITCH), LINE_COLOR, 1.0)
	for wall: Node in get_parent().get_node("Walls").get_children():
		var rect := Arena.wall_rect(wall as CollisionShape2D)
		draw_rect(rect, WALL_COLOR)
		draw_rect(rect, EDGE_COLOR, false, 2.0)
