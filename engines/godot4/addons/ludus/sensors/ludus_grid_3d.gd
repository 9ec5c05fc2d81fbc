@tool
@icon("res://addons/ludus/icons/ludus_sensor.svg")
class_name LudusGrid3D
extends LudusSensor3D
## A grid of cells around the node in 3D: how many members of each group are in each cell.
##
## The grid lies around the node and turns with it. Its numbers go from 0 to 1: by group, then by
## z, then by y, then by x.

## Cells along x, y and z.
@export var cells: Vector3i = Vector3i(5, 1, 5):
	set(value):
		cells = value
		redraw()
## Size of a cell, metres.
@export var cell_size: Vector3 = Vector3(2.0, 2.0, 2.0):
	set(value):
		cell_size = value
		redraw()
## Groups whose members are counted.
@export var groups: Array[StringName] = []
## So many members, and more, are 1.
@export_range(1, 1000) var full_count: int = 1


func count_values() -> int:
	return cells.x * cells.y * cells.z * groups.size()


func lowest_value() -> float:
	return 0.0


func sense() -> PackedFloat32Array:
	var seen := PackedFloat32Array()
	seen.resize(count_values())
	var start := 0
	for group: StringName in groups:
		for node: Node3D in members_of(group):
			var cell := Vector3i((place_of(node) / cell_size + Vector3(cells) / 2.0).floor())
			if cell == cell.clamp(Vector3i.ZERO, cells - Vector3i.ONE):
				var i := start + (cell.z * cells.y + cell.y) * cells.x + cell.x
				seen[i] = minf(seen[i] + 1.0 / full_count, 1.0)
		start += cells.x * cells.y * cells.z
	return seen


func lines() -> PackedVector3Array:
	var points := PackedVector3Array()
	var size := Vector3(cells) * cell_size
	for axis: int in 3:
		var i := (axis + 1) % 3
		var k := (axis + 2) % 3
		for a: int in cells[i] + 1:
			for b: int in cells[k] + 1:
				var from := -size / 2.0
				from[i] += a * cell_size[i]
				from[k] += b * cell_size[k]
				var to := from
				to[axis] += size[axis]
				points.append(from)
				points.append(to)
	return points
