extends RefCounted
## A square room with inner walls, in closed form: moves of circles, rays of vision, clear lines.
##
## Inner walls are capsules, segments with a thickness. There is no physics space: what a cast
## against walls needs is a few multiplications here, in any copy of the world alike.

## Half the side of the room, pixels: the map's radius. The outer walls begin there.
const RADIUS := 250.0
## Thickness of all walls, pixels.
const THICKNESS := 5.0
## Length of an inner wall, pixels: at least 0.56 of the map's radius.
const SHORTEST_WALL := 0.56 * RADIUS
const LONGEST_WALL := RADIUS
## Room left around the ends of an inner wall, pixels: a body of 20 pixels gets through everywhere.
const PASSAGE := 46.0

const _HALF_THICKNESS := THICKNESS / 2.0
const _MAX_TRIES := 40

## Both ends of each inner wall, one after the other, pixels from the middle of the room.
var ends := PackedVector2Array()
## Half the thickness of inner walls for bodies that move, pixels.
var half_thickness: float = _HALF_THICKNESS
## Whether a wall that a circle overlaps from the start stops it. Godot's [code]cast_motion()[/code]
## lets it through.
var stops_overlapping: bool = true
## What a moved circle keeps from walls, pixels; far above what 32-bit numbers lose.
var gap: float = 0.01

## From the room into a frame in which the wall lies along x, its middle at zero.
var _frames: Array[Transform2D] = []
## The same without the shift, for directions.
var _turns: Array[Transform2D] = []
var _half_lengths := PackedFloat64Array()


## Puts [param count] walls at random places; fewer if there is no room for so many. Their lengths
## lie between [param shortest] and [param longest], pixels.
func build(
	rng: RandomNumberGenerator,
	count: int,
	shortest: float = SHORTEST_WALL,
	longest: float = LONGEST_WALL
) -> void:
	clear()
	for i: int in count:
		for attempt: int in _MAX_TRIES:
			var half := rng.randf_range(shortest, longest) / 2.0
			var along := Vector2.from_angle(rng.randf_range(0.0, PI)) * half
			var reach := Vector2.ONE * (RADIUS - PASSAGE) - along.abs()
			var x := rng.randf_range(-reach.x, reach.x)
			var middle := Vector2(x, rng.randf_range(-reach.y, reach.y))
			if _is_apart(middle - along, middle + along):
				add_wall(middle - along, middle + along)
				break


## Removes all inner walls.
func clear() -> void:
	ends.clear()
	_frames.clear()
	_turns.clear()
	_half_lengths.clear()


## Adds an inner wall between two points.
func add_wall(from: Vector2, to: Vector2) -> void:
	var to_room := Transform2D((to - from).angle(), (from + to) / 2.0)
	ends.append(from)
	ends.append(to)
	_frames.append(to_room.affine_inverse())
	_turns.append(Transform2D(to_room.get_rotation(), Vector2.ZERO).affine_inverse())
	_half_lengths.append(from.distance_to(to) / 2.0)


## Whether a circle of [param radius] overlaps no wall.
func is_free(place: Vector2, radius: float) -> bool:
	return clearance(place) >= radius


## Distance to the nearest wall, pixels.
func clearance(place: Vector2) -> float:
	var distance := RADIUS - maxf(absf(place.x), absf(place.y))
	for i: int in _half_lengths.size():
		var nearest := Geometry2D.get_closest_point_to_segment(place, ends[2 * i], ends[2 * i + 1])
		distance = minf(distance, nearest.distance_to(place) - half_thickness)
	return distance


## A random place for a circle of [param radius], at least [param distance] pixels from each of
## [param others].
func free_place(
	rng: RandomNumberGenerator, radius: float, others: PackedVector2Array, distance: float
) -> Vector2:
	var reach := RADIUS - radius - 1.0
	while true:
		var x := rng.randf_range(-reach, reach)
		var place := Vector2(x, rng.randf_range(-reach, reach))
		var is_apart := true
		for other: Vector2 in others:
			is_apart = is_apart and place.distance_to(other) >= distance
		if is_apart and is_free(place, radius + 1.0):
			return place
	return Vector2.ZERO


## Returns where a circle of [param radius] comes to that moves straight by [param motion] until it
## meets a wall.
func move(place: Vector2, motion: Vector2, radius: float) -> Vector2:
	return place + motion * free_share(place, motion, radius)


## Returns the share, 0 to 1, of [param motion] that a circle of [param radius] can move.
func free_share(place: Vector2, motion: Vector2, radius: float) -> float:
	var reach := RADIUS - radius - gap
	var share := 1.0
	if absf(place.x + motion.x) > reach:
		share = minf(share, (reach - place.x * signf(motion.x)) / absf(motion.x))
	if absf(place.y + motion.y) > reach:
		share = minf(share, (reach - place.y * signf(motion.y)) / absf(motion.y))
	for i: int in _half_lengths.size():
		var near := _frames[i] * place
		var way := _turns[i] * motion
		var entry := _entry(near, way, _half_lengths[i], radius + half_thickness + gap)
		if entry > 0.0 or stops_overlapping:
			share = minf(share, entry)
	return maxf(share, 0.0)


## Whether no inner wall lies between two points.
func is_clear(from: Vector2, to: Vector2) -> bool:
	for i: int in _half_lengths.size():
		var near := _frames[i] * from
		if _entry(near, _turns[i] * (to - from), _half_lengths[i], half_thickness) < 1.0:
			return false
	return true


## Returns the distance to the nearest wall along each of [param directions], unit vectors, pixels.
func distances(from: Vector2, directions: PackedVector2Array) -> PackedFloat32Array:
	var found := PackedFloat32Array()
	found.resize(directions.size())
	var ray := 0
	for way: Vector2 in directions:
		found[ray] = minf(
			(RADIUS - from.x * signf(way.x)) / absf(way.x),
			(RADIUS - from.y * signf(way.y)) / absf(way.y)
		)
		ray += 1
	for i: int in _half_lengths.size():
		_shorten(found, _frames[i] * from, _turns[i] * directions, _half_lengths[i])
	return found


## Shortens rays that meet a wall, in its frame: a capsule of half length [param half] along x.
func _shorten(
	found: PackedFloat32Array, near: Vector2, directions: PackedVector2Array, half: float
) -> void:
	# The side that a ray can enter through, unless it starts level with the wall.
	var side := signf(near.y)
	var rise := maxf(absf(near.y) - _HALF_THICKNESS, 0.0)
	var ray := 0
	for way: Vector2 in directions:
		var fall := -way.y * side
		if fall > 0.0 or rise == 0.0:
			var distance := rise / fall if rise > 0.0 else 0.0
			var x := near.x + way.x * distance
			if absf(x) > half:
				distance = _cap_entry(near, way, half * signf(x))
			if distance < found[ray]:
				found[ray] = distance
		ray += 1


## Returns the distance along a unit vector to an end of a wall, [code]INF[/code] if it is missed.
static func _cap_entry(near: Vector2, way: Vector2, cap_x: float) -> float:
	var x := cap_x - near.x
	var along := x * way.x - near.y * way.y
	if along <= 0.0:
		return INF
	var room := _HALF_THICKNESS * _HALF_THICKNESS + along * along - x * x - near.y * near.y
	return along - sqrt(room) if room >= 0.0 else INF


## Returns after which share of [param way] a point enters a capsule along x of half length
## [param half] and radius [param reach]: 0 if it is inside and goes further in, [code]INF[/code]
## if it never does.
static func _entry(near: Vector2, way: Vector2, half: float, reach: float) -> float:
	var inner := near - Vector2(clampf(near.x, -half, half), 0.0)
	if inner.length_squared() <= reach * reach:
		return 0.0 if inner.dot(way) < 0.0 else INF
	var rise := absf(near.y) - reach
	var x := near.x
	if rise > 0.0:
		var fall := -way.y * signf(near.y)
		if fall <= 0.0:
			return INF
		x += way.x * rise / fall
		if absf(x) <= half:
			return rise / fall
	return circle_entry(Vector2(half * signf(x), 0.0) - near, way, reach)


## Returns after which share of [param way] a point comes within [param reach] of another one that
## lies at [param offset] from it; [code]INF[/code] if it never does.
static func circle_entry(offset: Vector2, way: Vector2, reach: float) -> float:
	var along := offset.dot(way)
	if along <= 0.0:
		return INF
	var length_squared := way.length_squared()
	var room := along * along - length_squared * (offset.length_squared() - reach * reach)
	return maxf((along - sqrt(room)) / length_squared, 0.0) if room >= 0.0 else INF


func _is_apart(from: Vector2, to: Vector2) -> bool:
	for i: int in _half_lengths.size():
		var pair := Geometry2D.get_closest_points_between_segments(
			from, to, ends[2 * i], ends[2 * i + 1]
		)
		if pair[0].distance_to(pair[1]) < PASSAGE:
			return false
	return true
