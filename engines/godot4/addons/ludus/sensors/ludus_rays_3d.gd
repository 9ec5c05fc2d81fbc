@tool
@icon("res://addons/ludus/icons/ludus_sensor.svg")
class_name LudusRays3D
extends LudusSensor3D
## Rays in 3D: how far each gets, 0 to 1, and what it meets.
##
## The rays begin at the node; the middle one points along -z. For each ray comes its distance as a
## share of [member reach], 1 where it meets nothing, and then a number for each of
## [member hit_groups], 1 where what it meets is in that group. The body that the sensor is part of
## is not met.

## How the rays lie.
enum Pattern {
	CONE,  ## Evenly in a cone around -z; with a spread of 360 in all directions.
	FAN,  ## Side by side in the plane of x and z.
}

## How the rays lie.
@export var pattern: LudusRays3D.Pattern = Pattern.CONE:
	set(value):
		pattern = value
		_forget()
## Number of rays.
@export_range(1, 512) var count: int = 16:
	set(value):
		count = value
		_forget()
## How far a ray reaches, metres.
@export var reach: float = 20.0:
	set(value):
		reach = value
		_forget()
## Opening angle, degrees: of the cone, or between the first and the last ray of a fan.
@export_range(0.0, 360.0) var spread: float = 360.0:
	set(value):
		spread = value
		_forget()
## Radius of a sphere that is swept along each ray, metres; 0: a thin ray.
@export_range(0.0, 100.0, 0.01, "or_greater") var thickness: float = 0.0:
	set(value):
		thickness = value
		_forget()
## The layers in which rays meet something.
@export_flags_3d_physics var collision_mask: int = 1:
	set(value):
		collision_mask = value
		_forget()
## Whether rays meet areas, too.
@export var collide_with_areas: bool = false:
	set(value):
		collide_with_areas = value
		_forget()
## Groups that are told apart.
@export var hit_groups: Array[StringName] = []:
	set(value):
		hit_groups = value
		_forget()

var _ends := PackedVector3Array()
var _ray: RayCast3D
var _sweep: ShapeCast3D
var _num_values: int = 0
var _seen := PackedFloat32Array()


func count_values() -> int:
	return count * (1 + hit_groups.size())


func lowest_value() -> float:
	return 0.0


func sense() -> PackedFloat32Array:
	if _world == null or _world.num_placed != _world.num_beginnings:
		settle()
	if _ends.is_empty():
		_prepare()
	var seen := PackedFloat32Array()
	seen.resize(_num_values)
	if _sweep != null:
		_sweep_all(seen)
	elif hit_groups.is_empty():
		_cast_all(seen)
	else:
		_cast_and_tell(seen)
	if _is_drawn:
		_seen = seen
		redraw()
	return seen


## The quick case. One ray node is turned, and only when somebody looks: an enabled RayCast3D works
## in every tick, and a query of the space makes a dictionary.
func _cast_all(seen: PackedFloat32Array) -> void:
	seen.fill(1.0)
	var eye := global_position
	for i: int in count:
		_ray.target_position = _ends[i]
		_ray.force_raycast_update()
		if _ray.is_colliding():
			seen[i] = minf(eye.distance_to(_ray.get_collision_point()) / reach, 1.0)


func _cast_and_tell(seen: PackedFloat32Array) -> void:
	var eye := global_position
	var next := 0
	for end: Vector3 in _ends:
		_ray.target_position = end
		_ray.force_raycast_update()
		seen[next] = 1.0
		if _ray.is_colliding():
			seen[next] = minf(eye.distance_to(_ray.get_collision_point()) / reach, 1.0)
			_tell(_ray.get_collider() as Node, seen, next + 1)
		next += 1 + hit_groups.size()


func _sweep_all(seen: PackedFloat32Array) -> void:
	var next := 0
	for end: Vector3 in _ends:
		_sweep.target_position = end
		_sweep.force_shapecast_update()
		seen[next] = 1.0
		if _sweep.is_colliding():
			seen[next] = _sweep.get_closest_collision_safe_fraction()
			_tell(_sweep.get_collider(0) as Node, seen, next + 1)
		next += 1 + hit_groups.size()


func _tell(met: Node, seen: PackedFloat32Array, from: int) -> void:
	for i: int in hit_groups.size():
		if met != null and met.is_in_group(hit_groups[i]):
			seen[from + i] = 1.0


func _forget() -> void:
	_ends.clear()
	_seen.clear()
	redraw()


func _prepare() -> void:
	_ends = _ray_ends()
	_num_values = count_values()
	for cast: Node3D in [_ray, _sweep]:
		if cast != null:
			cast.free()
	_ray = null
	_sweep = null
	var made: Node3D
	if thickness > 0.0:
		_sweep = ShapeCast3D.new()
		var sphere := SphereShape3D.new()
		sphere.radius = thickness
		_sweep.shape = sphere
		_sweep.max_results = 1
		made = _sweep
	else:
		_ray = RayCast3D.new()
		made = _ray
	made.set(&"enabled", false)
	made.set(&"collision_mask", collision_mask)
	made.set(&"collide_with_areas", collide_with_areas)
	add_child(made, false, Node.INTERNAL_MODE_BACK)
	if own_body() != null:
		made.call(&"add_exception", own_body())


func _ray_ends() -> PackedVector3Array:
	return _fan() if pattern == Pattern.FAN else _cone()


func _fan() -> PackedVector3Array:
	var ends := PackedVector3Array()
	var is_around := spread >= 360.0
	var step := deg_to_rad(spread) / maxi(count if is_around else count - 1, 1)
	var first := 0.0 if is_around or count == 1 else -deg_to_rad(spread) / 2.0
	for i: int in count:
		ends.append(Vector3.FORWARD.rotated(Vector3.DOWN, first + i * step) * reach)
	return ends


## A spiral by the golden angle, which puts about as many rays into each part of the cone.
func _cone() -> PackedVector3Array:
	var ends := PackedVector3Array()
	var height := 1.0 - cos(deg_to_rad(spread) / 2.0)
	for i: int in count:
		var depth := 1.0 - height * (i + 0.5) / count if count > 1 else 1.0
		var turn := PI * (3.0 - sqrt(5.0)) * i
		var radius := sqrt(maxf(1.0 - depth * depth, 0.0))
		ends.append(Vector3(cos(turn) * radius, sin(turn) * radius, -depth) * reach)
	return ends


func lines() -> PackedVector3Array:
	var points := PackedVector3Array()
	var ends := _ray_ends()
	for i: int in ends.size():
		var value := i * (1 + hit_groups.size())
		points.append(Vector3.ZERO)
		points.append(ends[i] * (_seen[value] if value < _seen.size() else 1.0))
	return points
