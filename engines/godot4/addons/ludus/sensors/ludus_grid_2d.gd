@tool
@icon("res://addons/ludus/icons/ludus_sensor.svg")
class_name LudusGrid2D
extends LudusSensor2D
## A grid of cells around the node in 2D: how many members of each group are in each cell.
##
## The grid lies around the node and turns with it. Its numbers go from 0 to 1: by group, then by
## row (y), then by column (x).

## Columns and rows.
@export var cells: Vector2i = Vector2i(5, 5):
	set(value):
		cells = value
		queue_redraw()
## Size of a cell, pixels.
@export var cell_size: Vector2 = Vector2(64.0, 64.0):
	set(value):
		cell_size = value
		queue_redraw()
## Groups whose members are counted.
@export var groups: Array[StringName] = []
## So many members, and more, are 1.
@export_range(1, 1000) var full_count: int = 1


func count_values() -> int:
	return cells.x * cells.y * groups.size()


func lowest_value() -> float:
	return 0.0


func sense() -> PackedFloat32Array:
	var seen := PackedFloat32Array()
	seen.resize(count_values())
	var start := 0
	for group: StringName in groups:
		for node: Node2D in members_of(group):
			var cell := Vector2i((place_of(node) / cell_size + Vector2(cells) / 2.0).floor())
			if Rect2i(Vector2i.ZERO, cells).has_point(cell):
				var i := start + cell.y * cells.x + cell.x
				seen[i] = minf(seen[i] + 1.0 / full_count, 1.0)
		start += cells.x * cells.y
	return seen


func _draw() -> void:
	if not _is_drawn:
		return
	var size := Vector2(cells) * cell_size
	for x: int in cells.x + 1:
		var left := x * cell_size.x - size.x / 2.0
		draw_line(Vector2(left, -size.y / 2.0), Vector2(left, size.y / 2.0), COLOUR)
	for y: int in cells.y + 1:
		var top := y * cell_size.y - size.y / 2.0
		draw_line(Vector2(-size.x / 2.0, top), Vector2(size.x / 2.0, top), COLOUR)
