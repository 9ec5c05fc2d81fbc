@tool
@icon("res://addons/ludus/icons/ludus_sensor.svg")
class_name LudusRelative3D
extends LudusSensor3D
## What chosen nodes are like from here, in 3D: place, direction, velocity and rotation, in the
## sensor's frame.
##
## All numbers go from -1 to 1. A node that is gone is zeros.

## What is reported of each node, in this order.
enum Part {
	POSITION = 1,  ## 3 numbers: place / [member reach].
	DIRECTION = 2,  ## 3 numbers: towards the node, length 1.
	VELOCITY = 4,  ## 3 numbers: velocity / [member full_speed].
	ROTATION = 8,  ## 3 numbers: where its -z points.
}

## The nodes.
@export var nodes: Array[Node3D] = []
## What is reported of each.
@export_flags("Position:1", "Direction:2", "Velocity:4", "Rotation:8") var parts: int = 1
## A position this far away, metres, is 1.
@export var reach: float = 100.0
## The speed, in metres per second, that becomes 1.
@export var full_speed: float = 20.0


func count_values() -> int:
	var count := 0
	for part: int in Part.values():
		count += 3 if parts & part else 0
	return count * nodes.size()


func sense() -> PackedFloat32Array:
	var seen := PackedFloat32Array()
	for node: Node3D in nodes:
		if is_instance_valid(node) and not node.is_queued_for_deletion():
			_tell(node, seen)
		else:
			seen.resize(seen.size() + count_values() / nodes.size())
	if _is_drawn:
		redraw()
	return seen


func _tell(node: Node3D, seen: PackedFloat32Array) -> void:
	var place := place_of(node)
	if parts & Part.POSITION:
		_append(seen, (place / reach).clampf(-1.0, 1.0))
	if parts & Part.DIRECTION:
		_append(seen, place.normalized())
	if parts & Part.VELOCITY:
		_append(seen, (velocity_of(node) / full_speed).clampf(-1.0, 1.0))
	if parts & Part.ROTATION:
		var own := transform_in_world(self).basis.orthonormalized()
		_append(seen, own.inverse() * -transform_in_world(node).basis.orthonormalized().z)


static func _append(seen: PackedFloat32Array, value: Vector3) -> void:
	seen.append(value.x)
	seen.append(value.y)
	seen.append(value.z)


func lines() -> PackedVector3Array:
	var points := PackedVector3Array()
	for node: Node3D in nodes:
		if is_instance_valid(node) and node.is_inside_tree():
			points.append(Vector3.ZERO)
			points.append(to_local(node.global_position))
	return points
