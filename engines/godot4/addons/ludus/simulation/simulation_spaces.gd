extends RefCounted
## The physics spaces of a [LudusSimulation], made on first use, and what it made in them.

## Half the size of the region that is searched along an axis on which nothing else lies.
const FAR := 1e6
const MAX_FOUND := 4096
const SETTING_2D := "physics/2d/default_"
const SETTING_3D := "physics/3d/default_"

## Scripts whose simulations were reported already: once for each process, not for each of thousands
## of worlds. A few paths at most.
static var _reported: Dictionary[String, bool] = {}

## What [method clear] frees, in the order in which it was made.
var owned_2d: Array[RID] = []
var owned_3d: Array[RID] = []

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
	if not _space_2d.is_valid():
		_space_2d = _host.get_world_2d().space if _is_shared else _make_2d()
	return _space_2d


## The 3D space.
func space_3d() -> RID:
	if not _space_3d.is_valid():
		_space_3d = _host.get_viewport().find_world_3d().space if _is_shared else _make_3d()
	return _space_3d


## Whether there is a space that other worlds use too.
func is_sharing() -> bool:
	return _is_shared and (_space_2d.is_valid() or _space_3d.is_valid())


## Stops the physics of spaces that are not shared, or lets it go on.
func set_active(is_active: bool) -> void:
	if _is_shared:
		return
	if _space_2d.is_valid():
		PhysicsServer2D.space_set_active(_space_2d, is_active)
	if _space_3d.is_valid():
		PhysicsServer3D.space_set_active(_space_3d, is_active)


## Frees everything. If something is left in the spaces of a simulation, warns of it once per
## script; [param region] is the simulation's part of a shared space.
func clear(script_path: String, region: AABB) -> void:
	while not owned_2d.is_empty():
		PhysicsServer2D.free_rid(owned_2d.pop_back())
	while not owned_3d.is_empty():
		PhysicsServer3D.free_rid(owned_3d.pop_back())
	if not _reported.has(script_path):
		_report(script_path, region)
	if _space_2d.is_valid() and not _is_shared:
		PhysicsServer2D.free_rid(_space_2d)
	if _space_3d.is_valid() and not _is_shared:
		PhysicsServer3D.free_rid(_space_3d)
	_space_2d = RID()
	_space_3d = RID()


func _report(script_path: String, region: AABB) -> void:
	var left := PackedStringArray()
	if _space_2d.is_valid():
		left.append_array(_left_2d(region))
	if _space_3d.is_valid():
		left.append_array(_left_3d(region))
	if left.is_empty():
		return
	_reported[script_path] = true
	var text := "ludus: %s leaves %s behind: hand them to own_2d() or own_3d(), or free them in "
	push_warning((text + "clean_up()") % [script_path, ", ".join(left)])


## What lies in the 2D space, in words. Godot cannot list the content of a space, but what has no
## layer at all is rare.
func _left_2d(region: AABB) -> PackedStringArray:
	var box := PhysicsServer2D.rectangle_shape_create()
	PhysicsServer2D.shape_set_data(box, Vector2(region.size.x, region.size.y) / 2.0)
	var query := PhysicsShapeQueryParameters2D.new()
	query.shape_rid = box
	var center := region.get_center()
	query.transform = Transform2D(0.0, Vector2(center.x, center.y))
	var state := PhysicsServer2D.space_get_direct_state(_space_2d)
	var counts := PackedInt32Array([0, 0, 0])
	for kind: int in 2:
		query.collide_with_bodies = kind == 0
		query.collide_with_areas = kind == 1
		var found := _distinct(state.intersect_shape(query, MAX_FOUND))
		counts[kind] = found.size()
		for rid: RID in found:
			counts[2] += (
				PhysicsServer2D.body_get_shape_count(rid)
				if kind == 0
				else PhysicsServer2D.area_get_shape_count(rid)
			)
	PhysicsServer2D.free_rid(box)
	return _in_words(counts, "2D")


func _left_3d(region: AABB) -> PackedStringArray:
	var box := PhysicsServer3D.box_shape_create()
	PhysicsServer3D.shape_set_data(box, region.size / 2.0)
	var query := PhysicsShapeQueryParameters3D.new()
	query.shape_rid = box
	query.transform = Transform3D(Basis.IDENTITY, region.get_center())
	var state := PhysicsServer3D.space_get_direct_state(_space_3d)
	var counts := PackedInt32Array([0, 0, 0])
	for kind: int in 2:
		query.collide_with_bodies = kind == 0
		query.collide_with_areas = kind == 1
		var found := _distinct(state.intersect_shape(query, MAX_FOUND))
		counts[kind] = found.size()
		for rid: RID in found:
			counts[2] += (
				PhysicsServer3D.body_get_shape_count(rid)
				if kind == 0
				else PhysicsServer3D.area_get_shape_count(rid)
			)
	PhysicsServer3D.free_rid(box)
	return _in_words(counts, "3D")


static func _distinct(found: Array[Dictionary]) -> Array[RID]:
	var rids: Array[RID] = []
	for hit: Dictionary in found:
		if hit["rid"] not in rids:
			rids.append(hit["rid"])
	return rids


static func _in_words(counts: PackedInt32Array, dimensions: String) -> PackedStringArray:
	var words := PackedStringArray()
	var nouns: Array[PackedStringArray] = [
		["body", "bodies"], ["area", "areas"], ["shape", "shapes"]
	]
	for i: int in counts.size():
		if counts[i] > 0:
			words.append("%d %s %s" % [counts[i], dimensions, nouns[i][int(counts[i] > 1)]])
	return words


## A new space has no gravity; this gives it what the project asks for.
func _make_2d() -> RID:
	var space := PhysicsServer2D.space_create()
	PhysicsServer2D.space_set_active(space, true)
	var values := {
		PhysicsServer2D.AREA_PARAM_GRAVITY: "gravity",
		PhysicsServer2D.AREA_PARAM_GRAVITY_VECTOR: "gravity_vector",
		PhysicsServer2D.AREA_PARAM_LINEAR_DAMP: "linear_damp",
		PhysicsServer2D.AREA_PARAM_ANGULAR_DAMP: "angular_damp",
	}
	for parameter: PhysicsServer2D.AreaParameter in values:
		var value: Variant = ProjectSettings.get_setting(SETTING_2D + str(values[parameter]))
		PhysicsServer2D.area_set_param(space, parameter, value)
	return space


func _make_3d() -> RID:
	var space := PhysicsServer3D.space_create()
	PhysicsServer3D.space_set_active(space, true)
	var values := {
		PhysicsServer3D.AREA_PARAM_GRAVITY: "gravity",
		PhysicsServer3D.AREA_PARAM_GRAVITY_VECTOR: "gravity_vector",
		PhysicsServer3D.AREA_PARAM_LINEAR_DAMP: "linear_damp",
		PhysicsServer3D.AREA_PARAM_ANGULAR_DAMP: "angular_damp",
	}
	for parameter: PhysicsServer3D.AreaParameter in values:
		var value: Variant = ProjectSettings.get_setting(SETTING_3D + str(values[parameter]))
		PhysicsServer3D.area_set_param(space, parameter, value)
	return space
