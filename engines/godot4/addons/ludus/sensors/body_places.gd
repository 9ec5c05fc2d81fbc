extends RefCounted
## Puts bodies where [code]reset()[/code] has moved their nodes, at once: a physics server looks at
## the places of nodes late, and casts would meet bodies where they were before.

const LudusGroupMembers := preload("res://addons/ludus/sensors/group_members.gd")


## Brings the bodies of a world up to date, once for each beginning of an episode.
static func settle(world: LudusWorld) -> void:
	if world.num_placed == world.num_beginnings:
		return
	world.num_placed = world.num_beginnings
	LudusGroupMembers.forget()
	for node: Node in world.root.find_children("*", "CollisionObject2D", true, false):
		_place_2d(node as CollisionObject2D)
	for node: Node in world.root.find_children("*", "CollisionObject3D", true, false):
		_place_3d(node as CollisionObject3D)


static func _place_2d(body: CollisionObject2D) -> void:
	body.force_update_transform()
	if body is Area2D:
		return
	var rid := body.get_rid()
	var place := body.global_transform
	if PhysicsServer2D.body_get_state(rid, PhysicsServer2D.BODY_STATE_TRANSFORM) == place:
		return
	var mode := PhysicsServer2D.body_get_mode(rid)
	if mode == PhysicsServer2D.BODY_MODE_KINEMATIC:  # which moves in the next tick only
		PhysicsServer2D.body_set_mode(rid, PhysicsServer2D.BODY_MODE_STATIC)
	PhysicsServer2D.body_set_state(rid, PhysicsServer2D.BODY_STATE_TRANSFORM, place)
	if mode == PhysicsServer2D.BODY_MODE_KINEMATIC:
		PhysicsServer2D.body_set_mode(rid, mode)


static func _place_3d(body: CollisionObject3D) -> void:
	body.force_update_transform()
	if body is Area3D:
		return
	var rid := body.get_rid()
	var place := body.global_transform
	if PhysicsServer3D.body_get_state(rid, PhysicsServer3D.BODY_STATE_TRANSFORM) == place:
		return
	var mode := PhysicsServer3D.body_get_mode(rid)
	if mode == PhysicsServer3D.BODY_MODE_KINEMATIC:
		PhysicsServer3D.body_set_mode(rid, PhysicsServer3D.BODY_MODE_STATIC)
	PhysicsServer3D.body_set_state(rid, PhysicsServer3D.BODY_STATE_TRANSFORM, place)
	if mode == PhysicsServer3D.BODY_MODE_KINEMATIC:
		PhysicsServer3D.body_set_mode(rid, mode)
