extends RefCounted
## Where the rules of godot-ai's two games differ from those of ours: a body looks with all of its
## width, walls have none, nobody is squeezed in at the start, and memory begins full.
##
## A scene chooses them by the metadata [code]rules = "original"[/code] of its root.

const Map := preload("res://examples/shared/walled_map.gd")
const Walker := preload("res://examples/shared/walker.gd")

const METADATA := &"rules"
const OURS := "ours"
const ORIGINAL := "original"
## Distance that moves keep from walls and bodies, pixels.
const MARGIN := 5.0
## Walls and starts lie within this distance from the middle along each axis, pixels.
const REACH := 0.75 * Map.RADIUS
## Room around a start, from the centre to walls and to the edge of others, pixels.
const START_ROOM := 3.0 * Walker.RADIUS
## Distance of the centres at which two bodies touch, pixels.
const CONTACT := 2.0 * Walker.RADIUS
## What a body that one runs into reads as: this times the distance of its edge.
const TOUCH_SHARE := 0.2

## The shares that [method cast] returns, from 0 up.
static var _cast_shares := _list_cast_shares()


## Whether the root of a world chooses the original's rules.
static func are_chosen(world: LudusWorld) -> bool:
	var root := world.get_parent()
	var rules: Variant = OURS if root == null else root.get_meta(METADATA, OURS)
	if rules not in [OURS, ORIGINAL]:
		var known := "%s or %s" % [OURS, ORIGINAL]
		push_error("ludus: metadata rules of %s: %s is neither %s" % [root.name, rules, known])
	return rules is String and rules == ORIGINAL


## Draws a point for the end of a wall, or for a start.
static func draw_point(rng: RandomNumberGenerator) -> Vector2:
	var x := rng.randf_range(-REACH, REACH)
	return Vector2(x, rng.randf_range(-REACH, REACH))


## Draws a start that has room on all sides, at least [param distance] pixels from [param others].
static func draw_start(
	rng: RandomNumberGenerator, map: Map, others: PackedVector2Array, distance: float
) -> Vector2:
	while true:
		var place := draw_point(rng)
		var is_apart := true
		for other: Vector2 in others:
			is_apart = is_apart and place.distance_to(other) >= distance
		if is_apart and map.is_free(place, START_ROOM):
			return place
	return Vector2.ZERO


## Returns the share of a way that Godot's [code]cast_motion()[/code] finds free, where the way is
## free until a share [param entry]. It halves the way eight times, nearer to an end where it went
## before.
static func cast(entry: float) -> float:
	return 1.0 if entry >= 1.0 else _cast_shares[_cast_shares.bsearch(entry, false) - 1]


## Returns where a body comes to that moves straight by [param motion], until a wall or another one.
## Bodies in [param others] that it touches already do not stop it.
static func move(
	map: Map, place: Vector2, motion: Vector2, others: PackedVector2Array = []
) -> Vector2:
	var share := map.free_share(place, motion, Walker.RADIUS + MARGIN)
	for other: Vector2 in others:
		if place.distance_to(other) >= CONTACT + MARGIN:
			share = minf(share, Map.circle_entry(other - place, motion, CONTACT + MARGIN))
	return place + motion * cast(share)


## Lets a body look along [param angles], fractions of π from straight ahead. Returns how far it
## could go that way until a wall, as a fraction of its sight.
static func look(map: Map, walker: Walker, angles: PackedFloat64Array) -> PackedFloat32Array:
	var shares := PackedFloat32Array()
	walker.rays = PackedVector2Array()
	walker.ray_lengths = PackedFloat32Array()
	for angle: float in angles:
		var ray := Vector2.from_angle(walker.rotation + angle * PI)
		shares.append(cast(map.free_share(walker.place, ray * Walker.SIGHT, Walker.RADIUS)))
		walker.rays.append(ray)
		walker.ray_lengths.append(shares[-1] * Walker.SIGHT)
	return shares


## Returns how far the body could go along each of its rays until it meets one of [param others], as
## a fraction of its sight; 1 behind a wall. Those that it touches are not met, but felt, if it
## [param feels] anything.
static func see(
	walker: Walker, walls: PackedFloat32Array, others: PackedVector2Array, feels: bool
) -> PackedFloat32Array:
	var shares := PackedFloat32Array()
	for i: int in walls.size():
		var ray := walker.rays[i]
		var share := 1.0
		for other: Vector2 in others:
			var way := other - walker.place
			if way.length() >= CONTACT:
				share = minf(share, Map.circle_entry(way, ray * Walker.SIGHT, CONTACT))
		var felt := _feel(walker.place, ray, others) if feels else -1.0
		share = felt if felt >= 0.0 else cast(share)
		shares.append(share if share <= walls[i] else 1.0)
	return shares


## Turns fresh senses into an observation: they, the last ten ones and the last actions, both with
## the oldest first. At the beginning all ten are the first ones. Who [param is_idle] remembers
## nothing new.
static func remember(
	walker: Walker, senses: PackedFloat32Array, num_numbers: int, is_idle: bool = false
) -> void:
	var size := senses.size()
	var before := walker.observation
	var next := senses.duplicate()
	if before.is_empty():
		for i: int in Walker.NUM_REMEMBERED:
			next.append_array(senses)
		next.resize(next.size() + num_numbers)
	elif is_idle:
		next.append_array(before.slice(size))
	else:
		var actions_at := size * (1 + Walker.NUM_REMEMBERED)
		next.append_array(before.slice(2 * size, actions_at))
		next.append_array(before.slice(0, size))
		next.append_array(before.slice(actions_at + walker.action.size()))
		next.append_array(walker.action)
	walker.observation = next


## What a body reads of the one that it would overlap most if it stepped on by its radius, or −1.
static func _feel(place: Vector2, ray: Vector2, others: PackedVector2Array) -> float:
	var reached := place + ray * Walker.RADIUS
	var felt := -1.0
	var nearest := CONTACT
	for other: Vector2 in others:
		var distance := reached.distance_to(other)
		if distance < nearest:
			nearest = distance
			var edge := other - reached.direction_to(other) * Walker.RADIUS
			felt = TOUCH_SHARE * place.distance_to(edge) / Walker.SIGHT
	return felt


static func _list_cast_shares() -> PackedFloat64Array:
	var shares := PackedFloat64Array()
	for choices: int in 256:
		var low := 0.0
		var high := 1.0
		var part := 0.5
		for halving: int in 8:
			var share := low + (high - low) * part
			if choices & (128 >> halving):
				low = share
				part = 0.75 if halving > 0 and high == 1.0 else 0.5
			else:
				high = share
				part = 0.25 if halving > 0 and low == 0.0 else 0.5
		shares.append(low)
	return shares
