class_name LudusSimulationSpaces
extends Reference
## The physics spaces of a [LudusSimulation], made on first use, and what it made in them.

## Half the size of the region that is searched along an axis on which nothing else lies.
const FAR := 1e6
const MAX_FOUND := 4096
const SETTING_2D := "physics/2d/default_"
const SETTING_3D := "physics/3d/default_"
## Bullet counts active spaces in eight bits, and steps none of them when there are more than 127;
## one is the root's.
const MAX_BULLET_SPACES := 126
const ENGINE_SETTING := "physics/3d/physics_engine"
const GODOT_PHYSICS := "GodotPhysics"
const NUM_3D := "num_3d"
## Scripts whose simulations were reported already. Godot 3 has no static variables; what a constant
## dictionary holds is shared all the same.
const _REPORTED := {}
## 3D spaces that are there, of all simulations.
const _COUNTS := {NUM_3D: 0}

## What is wrong, or an empty text.
var error: String = ""
## What [method clear] frees, in the order in which it was made.
var owned_2d: Array = []
var owned_3d: Array = []

var _host: Node2D
var _is_shared: bool
var _space_2d := RID()
var _space_3d := RID()


## Spaces that are shared are those of the viewport of [param host].
func _init(host: Node2D, is_shared: bool) -> void:
	_host = host
	_is_shared = is_shared


## The 2D space.
func space_2d() -> RID:
	if not _exists(_space_2d):
		_space_2d = _host.get_world_2d().space if _is_shared else _make_2d()
	return _space_2d


## The 3D space.
func space_3d() -> RID:
	if not _exists(_space_3d):
		_space_3d = _host.get_viewport().find_world().space if _is_shared else _make_3d()
	return _space_3d


## Whether there is a space that other worlds use too.
func is_sharing() -> bool:
	return _is_shared and (_exists(_space_2d) or _exists(_space_3d))


## Stops the physics of spaces that are not shared, or lets it go on.
func set_active(is_active: bool) -> void:
	if _is_shared:
		return
	if _exists(_space_2d):
		Physics2DServer.space_set_active(_space_2d, is_active)
	if _exists(_space_3d):
		PhysicsServer.space_set_active(_space_3d, is_active)


## Frees everything. If something is left in the spaces of a simulation, warns of it once per
## script; [param region] is the simulation's part of a shared space.
func clear(script_path: String, region: AABB) -> void:
	while not owned_2d.empty():
		Physics2DServer.free_rid(owned_2d.pop_back())
	while not owned_3d.empty():
		PhysicsServer.free_rid(owned_3d.pop_back())
	if not _REPORTED.has(script_path):
		_report(script_path, region)
	if _exists(_space_2d) and not _is_shared:
		Physics2DServer.free_rid(_space_2d)
	if _exists(_space_3d) and not _is_shared:
		PhysicsServer.free_rid(_space_3d)
		_COUNTS[NUM_3D] -= 1
	_space_2d = RID()
	_space_3d = RID()


static func _exists(space: RID) -> bool:
	return space.get_id() != 0


func _report(script_path: String, region: AABB) -> void:
	var left := PoolStringArray()
	if _exists(_space_2d):
		left.append_array(_left_2d(region))
	if _exists(_space_3d):
		left.append_array(_left_3d(region))
	if left.empty():
		return
	_REPORTED[script_path] = true
	var text := "ludus: %s leaves %s behind: hand them to own_2d() or own_3d(), or free them in "
	push_warning((text + "clean_up()") % [script_path, left.join(", ")])


## What lies in the 2D space, in words. Godot cannot list the content of a space, but what has no
## layer at all is rare.
func _left_2d(region: AABB) -> PoolStringArray:
	var box := Physics2DServer.rectangle_shape_create()
	Physics2DServer.shape_set_data(box, Vector2(region.size.x, region.size.y) / 2.0)
	var query := Physics2DShapeQueryParameters.new()
	query.shape_rid = box
	var center := region.position + region.size / 2.0
	query.transform = Transform2D(0.0, Vector2(center.x, center.y))
	var state := Physics2DServer.space_get_direct_state(_space_2d)
	var counts := [0, 0, 0]
	for kind in 2:
		query.collide_with_bodies = kind == 0
		query.collide_with_areas = kind == 1
		var found := _distinct(state.intersect_shape(query, MAX_FOUND))
		counts[kind] = found.size()
		for rid in found:
			counts[2] += (
				Physics2DServer.body_get_shape_count(rid)
				if kind == 0
				else Physics2DServer.area_get_shape_count(rid)
			)
	Physics2DServer.free_rid(box)
	return _in_words(counts, "2D")


func _left_3d(region: AABB) -> PoolStringArray:
	var box := PhysicsServer.shape_create(PhysicsServer.SHAPE_BOX)
	PhysicsServer.shape_set_data(box, region.size / 2.0)
	var query := PhysicsShapeQueryParameters.new()
	query.shape_rid = box
	query.transform = Transform(Basis(), region.position + region.size / 2.0)
	var state := PhysicsServer.space_get_direct_state(_space_3d)
	var counts := [0, 0, 0]
	for kind in 2:
		query.collide_with_bodies = kind == 0
		query.collide_with_areas = kind == 1
		var found := _distinct(state.intersect_shape(query, MAX_FOUND))
		counts[kind] = found.size()
		for rid in found:
			counts[2] += (
				PhysicsServer.body_get_shape_count(rid)
				if kind == 0
				else PhysicsServer.area_get_shape_count(rid)
			)
	PhysicsServer.free_rid(box)
	return _in_words(counts, "3D")


static func _distinct(found: Array) -> Array:
	var rids := []
	for hit in found:
		if not hit["rid"] in rids:
			rids.append(hit["rid"])
	return rids


static func _in_words(counts: Array, dimensions: String) -> PoolStringArray:
	var words := PoolStringArray()
	var nouns := [["body", "bodies"], ["area", "areas"], ["shape", "shapes"]]
	for i in counts.size():
		if counts[i] > 0:
			words.append("%d %s %s" % [counts[i], dimensions, nouns[i][int(counts[i] > 1)]])
	return words


## A new space has no gravity; this gives it what the project asks for.
func _make_2d() -> RID:
	var space := Physics2DServer.space_create()
	Physics2DServer.space_set_active(space, true)
	var values := {
		Physics2DServer.AREA_PARAM_GRAVITY: "gravity",
		Physics2DServer.AREA_PARAM_GRAVITY_VECTOR: "gravity_vector",
		Physics2DServer.AREA_PARAM_LINEAR_DAMP: "linear_damp",
		Physics2DServer.AREA_PARAM_ANGULAR_DAMP: "angular_damp",
	}
	for parameter in values:
		var value = ProjectSettings.get_setting(SETTING_2D + values[parameter])
		Physics2DServer.area_set_param(space, parameter, value)
	return space


func _make_3d() -> RID:
	_count_3d()
	var space := PhysicsServer.space_create()
	PhysicsServer.space_set_active(space, true)
	var values := {
		PhysicsServer.AREA_PARAM_GRAVITY: "gravity",
		PhysicsServer.AREA_PARAM_GRAVITY_VECTOR: "gravity_vector",
		PhysicsServer.AREA_PARAM_LINEAR_DAMP: "linear_damp",
		PhysicsServer.AREA_PARAM_ANGULAR_DAMP: "angular_damp",
	}
	for parameter in values:
		var value = ProjectSettings.get_setting(SETTING_3D + values[parameter])
		PhysicsServer.area_set_param(space, parameter, value)
	return space


## With more spaces Bullet moves nothing at all. A copy that has nodes in three dimensions brings
## another one.
func _count_3d() -> void:
	_COUNTS[NUM_3D] += 1
	var per_world := 2 if _host.get_viewport().own_world else 1
	var num_spaces: int = _COUNTS[NUM_3D] * per_world
	var has_bullet := str(ProjectSettings.get_setting(ENGINE_SETTING)) != GODOT_PHYSICS
	if num_spaces > MAX_BULLET_SPACES and has_bullet:
		error = (
			"%d 3D spaces: Bullet can keep %d; take more engines, the grid or %s=%s"
			% [num_spaces, MAX_BULLET_SPACES, ENGINE_SETTING, GODOT_PHYSICS]
		)
