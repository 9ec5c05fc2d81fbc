@tool
@icon("res://addons/ludus/icons/ludus_sensor.svg")
class_name LudusNearest3D
extends LudusSensor3D
## The nearest members of a group in 3D: where they are, in the sensor's frame, and how many.
##
## For each of [member count] members, the nearest first: place / [member reach] (3 numbers) and, if
## asked for, velocity / [member full_speed] (3 numbers); zeros where there are fewer. The last
## number is how many are in reach, as a share of [member count], at most 1.

## Group whose members are looked for.
@export var group: StringName = &""
## How many members are reported.
@export_range(1, 256) var count: int = 3
## How far the sensor sees, metres.
@export var reach: float = 50.0:
	set(value):
		reach = value
		redraw()
## Whether their velocities are reported, too: their property [code]velocity[/code] or
## [code]linear_velocity[/code].
@export var has_velocity: bool = false
## The speed, in metres per second, that becomes 1.
@export var full_speed: float = 20.0

var _places := PackedVector3Array()


func count_values() -> int:
	return count * (6 if has_velocity else 3) + 1


func sense() -> PackedFloat32Array:
	var found: Array[Array] = []
	for node: Node3D in members_of(group):
		var place := place_of(node)
		if place.length() <= reach:
			found.append([place.length_squared(), found.size(), node, place])
	found.sort()  # of two at one distance, the first in the tree
	var seen := PackedFloat32Array()
	_places.clear()
	for item: Array in found.slice(0, count):
		var place: Vector3 = item[3]
		_places.append(place)
		seen.append(place.x / reach)
		seen.append(place.y / reach)
		seen.append(place.z / reach)
		if has_velocity:
			var velocity := (velocity_of(item[2]) / full_speed).clampf(-1.0, 1.0)
			seen.append(velocity.x)
			seen.append(velocity.y)
			seen.append(velocity.z)
	seen.resize(count_values())
	seen[-1] = minf(float(found.size()) / count, 1.0)
	if _is_drawn:
		redraw()
	return seen


func lines() -> PackedVector3Array:
	var points := PackedVector3Array()
	for place: Vector3 in _places:
		points.append(Vector3.ZERO)
		points.append(place)
	for i: int in 32:
		for end: int in [i, i + 1]:
			points.append(Vector3.FORWARD.rotated(Vector3.UP, TAU * end / 32.0) * reach)
	return points
