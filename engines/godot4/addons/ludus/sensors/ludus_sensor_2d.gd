@tool
@icon("res://addons/ludus/icons/ludus_sensor.svg")
class_name LudusSensor2D
extends Node2D
## A sensor of an agent in 2D: an entry of its observation, called as the node is.
##
## Put sensors below the agent's node. For one of your own extend this script and write
## [method count_values] and [method sense]:
## [codeblock]
## @tool
## extends LudusSensor2D
##
## func count_values() -> int:
##     return 1
##
## func sense() -> PackedFloat32Array:
##     var turned := transform_in_world(own_body()).get_rotation()
##     return PackedFloat32Array([turned / PI])
## [/codeblock]

const LudusBodyPlaces := preload("res://addons/ludus/sensors/body_places.gd")
const LudusGroupMembers := preload("res://addons/ludus/sensors/group_members.gd")

## Colour of what the sensor draws in the editor, and with [b]Visible Collision Shapes[/b] on.
const COLOUR := Color(0.3, 0.8, 1.0, 0.5)
const HIT_COLOUR := Color(1.0, 0.45, 0.3, 0.9)

## Whether the sensor is an entry of the observation. Switched off, it is for the game's own code,
## which calls [method sense] in [code]get_observation()[/code].
@export var is_entry: bool = true

## The world that the sensor is in.
var world: LudusWorld:
	get:
		if _world == null:
			_world = LudusWorld.of(self)
		return _world

var _world: LudusWorld
## Whether the sensor draws itself: in the editor, and in a game with visible collision shapes.
var _is_drawn: bool = false
var _body: CollisionObject2D


func _enter_tree() -> void:
	_is_drawn = Engine.is_editor_hint() or get_tree().debug_collisions_hint


## Draws the sensor in the running game, as the editor does, or no longer. Its subclass draws what
## it sees when it is asked next.
func draw_in_game(is_wanted: bool) -> void:
	_is_drawn = is_wanted or (is_inside_tree() and get_tree().debug_collisions_hint)
	queue_redraw()


## How many numbers [method sense] returns.
func count_values() -> int:
	return 0


## The least that any of the numbers can be.
func lowest_value() -> float:
	return -1.0


## The most that any of the numbers can be.
func highest_value() -> float:
	return 1.0


## Looks, and returns [method count_values] numbers. It is called on decision ticks only.
func sense() -> PackedFloat32Array:
	return PackedFloat32Array()


## The entry of the observation, without its name.
func make_entry() -> LudusObservationEntry:
	var entry := LudusObservationEntry.create(name, [count_values()])
	entry.low = lowest_value()
	entry.high = highest_value()
	return entry


## Puts bodies where [code]reset()[/code] has moved their nodes. A sensor of your own that looks
## into the physics space calls this first.
func settle() -> void:
	if _world == null or _world.num_placed != _world.num_beginnings:
		LudusBodyPlaces.settle(world)


## The body that the sensor is part of, or null.
func own_body() -> CollisionObject2D:
	if _body == null:
		var ancestor := get_parent()
		while ancestor != null and ancestor is not CollisionObject2D:
			ancestor = ancestor.get_parent()
		_body = ancestor as CollisionObject2D
	return _body


## The members of a group in the sensor's world, without the body that it is part of.
func members_of(group: StringName) -> Array[Node2D]:
	settle()
	var found: Array[Node2D] = []
	for node: Node in LudusGroupMembers.of(world, group):
		if node is Node2D and node != own_body() and not node.is_ancestor_of(self):
			found.append(node as Node2D)
	return found


## Where a node is, in the sensor's frame, pixels. Where a copy lies in a grid does not show.
func place_of(node: Node2D) -> Vector2:
	return transform_in_world(self).affine_inverse() * transform_in_world(node).origin


## How a node moves, in the sensor's frame, pixels per second: by its [code]velocity[/code] or
## [code]linear_velocity[/code].
func velocity_of(node: Node2D) -> Vector2:
	var value: Variant = node.get(&"velocity")
	if value is not Vector2:
		value = node.get(&"linear_velocity")
	if value is not Vector2:
		return Vector2.ZERO
	return (value as Vector2).rotated(-transform_in_world(self).get_rotation())


## Place and rotation of a node in the coordinates of its world.
func transform_in_world(node: Node2D) -> Transform2D:
	var root := world.root as Node2D
	if root == node:
		return Transform2D.IDENTITY
	if root == null or not root.is_ancestor_of(node):
		return node.global_transform
	return node.get_relative_transform_to_parent(root)
