@tool
@icon("res://addons/ludus/icons/ludus_sensor.svg")
class_name LudusRelative2D
extends LudusSensor2D
## What chosen nodes are like from here, in 2D: place, direction, velocity and rotation, in the
## sensor's frame.
##
## All numbers go from -1 to 1. A node that is gone is zeros.

## What is reported of each node, in this order.
enum Part {
	POSITION = 1,  ## 2 numbers: place / [member reach].
	DIRECTION = 2,  ## 2 numbers: towards the node, length 1.
	VELOCITY = 4,  ## 2 numbers: velocity / [member full_speed].
	ROTATION = 8,  ## 2 numbers: cosine and sine of the angle between both.
}

## The nodes.
@export var nodes: Array[Node2D] = []
## What is reported of each.
@export_flags("Position:1", "Direction:2", "Velocity:4", "Rotation:8") var parts: int = 1
## A position this far away, pixels, is 1.
@export var reach: float = 1000.0
## The speed, in pixels per second, that becomes 1.
@export var full_speed: float = 500.0


func count_values() -> int:
	var count := 0
	for part: int in Part.values():
		count += 2 if parts & part else 0
	return count * nodes.size()


func sense() -> PackedFloat32Array:
	var seen := PackedFloat32Array()
	for node: Node2D in nodes:
		if is_instance_valid(node) and not node.is_queued_for_deletion():
			_tell(node, seen)
		else:
			seen.resize(seen.size() + count_values() / nodes.size())
	if _is_drawn:
		queue_redraw()
	return seen


func _tell(node: Node2D, seen: PackedFloat32Array) -> void:
	var place := place_of(node)
	if parts & Part.POSITION:
		_append(seen, (place / reach).clampf(-1.0, 1.0))
	if parts & Part.DIRECTION:
		_append(seen, place.normalized())
	if parts & Part.VELOCITY:
		_append(seen, (velocity_of(node) / full_speed).clampf(-1.0, 1.0))
	if parts & Part.ROTATION:
		var angle := transform_in_world(node).get_rotation()
		_append(seen, Vector2.from_angle(angle - transform_in_world(self).get_rotation()))


static func _append(seen: PackedFloat32Array, value: Vector2) -> void:
	seen.append(value.x)
	seen.append(value.y)


func _draw() -> void:
	if not _is_drawn:
		return
	for node: Node2D in nodes:
		if is_instance_valid(node):
			draw_dashed_line(Vector2.ZERO, to_local(node.global_position), COLOUR, 2.0)
