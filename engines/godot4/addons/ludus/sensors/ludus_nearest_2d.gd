@tool
@icon("res://addons/ludus/icons/ludus_sensor.svg")
class_name LudusNearest2D
extends LudusSensor2D
## The nearest members of a group in 2D: where they are, in the sensor's frame, and how many.
##
## For each of [member count] members, the nearest first: place / [member reach] (2 numbers) and, if
## asked for, velocity / [member full_speed] (2 numbers); zeros where there are fewer. The last
## number is how many are in reach, as a share of [member count], at most 1.

## Group whose members are looked for.
@export var group: StringName = &""
## How many members are reported.
@export_range(1, 256) var count: int = 3
## How far the sensor sees, pixels.
@export var reach: float = 500.0:
	set(value):
		reach = value
		queue_redraw()
## Whether their velocities are reported, too: their property [code]velocity[/code] or
## [code]linear_velocity[/code].
@export var has_velocity: bool = false
## The speed, in pixels per second, that becomes 1.
@export var full_speed: float = 500.0

var _places := PackedVector2Array()


func count_values() -> int:
	return count * (4 if has_velocity else 2) + 1


func sense() -> PackedFloat32Array:
	var found: Array[Array] = []
	for node: Node2D in members_of(group):
		var place := place_of(node)
		if place.length() <= reach:
			found.append([place.length_squared(), found.size(), node, place])
	found.sort()  # of two at one distance, the first in the tree
	var seen := PackedFloat32Array()
	_places.clear()
	for item: Array in found.slice(0, count):
		var place: Vector2 = item[3]
		_places.append(place)
		seen.append(place.x / reach)
		seen.append(place.y / reach)
		if has_velocity:
			var velocity := (velocity_of(item[2]) / full_speed).clampf(-1.0, 1.0)
			seen.append(velocity.x)
			seen.append(velocity.y)
	seen.resize(count_values())
	seen[-1] = minf(float(found.size()) / count, 1.0)
	if _is_drawn:
		queue_redraw()
	return seen


func _draw() -> void:
	if not _is_drawn:
		return
	draw_arc(Vector2.ZERO, reach, 0.0, TAU, 64, COLOUR)
	for place: Vector2 in _places:
		draw_line(Vector2.ZERO, place, HIT_COLOUR, 2.0)
