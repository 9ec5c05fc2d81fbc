extends "res://examples/shared/walker.gd"
## What soldier and zombies have in common: health, and three layers of rays.

const Fighter := preload("res://examples/zombies/fighter.gd")

## Angles of the rays from straight ahead, fractions of π: at 250 pixels no body fits between two.
const RAY_ANGLES: PackedFloat64Array = [
	0.0, 0.065, -0.065, 0.13, -0.13, 0.2, -0.2, 0.27, -0.27, 0.35, -0.35, 0.44, -0.44
]
## Rays see bodies this far to each side, pixels: what the middle one sees, a shot would hit.
const RAY_WIDTH := 5.0
const NUM_RAYS := 13
## Places of the numbers in the senses; friends only where there are some.
const WALLS_AT := 1
const ENEMIES_AT := WALLS_AT + NUM_RAYS
const FRIENDS_AT := ENEMIES_AT + NUM_RAYS

## What sliding keeps off the wall in a step, pixels: more than rounding takes.
const _OFF_WALL := 0.02

static var _fan := fan(RAY_ANGLES)

## From 1 down to 0, which is dead.
var health: float = 1.0
## Health lost in this step.
var pain: float = 0.0


## Whether it lives.
func is_alive() -> bool:
	return health > 0.0


## Begins an episode in full health.
func begin(at: Vector2, looking: float) -> void:
	super(at, looking)
	health = 1.0
	pain = 0.0


## Loses health.
func suffer(damage: float) -> void:
	# A trace left by subtracting 0.05 twenty times is no life.
	var left := health - damage if health - damage > 1e-6 else 0.0
	pain += health - left
	health = left


## Turns and walks as its action says, if it lives. [param is_turn] says how it turns: from where it
## looks, or to an angle of the room.
func act(map: Map, step: float, is_turn: bool) -> void:
	if is_alive():
		rotation = wrapf(action[2] * PI + (rotation if is_turn else 0.0), -PI, PI)
		_glide(map, Vector2(action[0], action[1]) * step)


## Returns the first senses: rotation, rays to walls, to [param enemies] and to [param friends],
## place, health and pain. Without room for friends they are left out.
func sense(
	map: Map, enemies: PackedVector2Array, friends: PackedVector2Array, num_layers: int
) -> PackedFloat32Array:
	look(map, _fan)
	var end := WALLS_AT + num_layers * NUM_RAYS
	var senses := PackedFloat32Array()
	senses.resize(end)
	senses.fill(1.0)
	senses[0] = rotation / PI
	for i: int in NUM_RAYS:
		senses[WALLS_AT + i] = ray_lengths[i] / SIGHT
	see(enemies, senses, ENEMIES_AT, RAY_WIDTH)
	if num_layers > 2:
		see(friends, senses, FRIENDS_AT, RAY_WIDTH)
	senses.append(place.x / Map.RADIUS)
	senses.append(place.y / Map.RADIUS)
	senses.append(scaled(health))
	senses.append(scaled(pain))
	return senses


## Moves by [param motion]; what a wall takes of it goes on along that wall.
func _glide(map: Map, motion: Vector2) -> void:
	var share := map.free_share(place, motion, RADIUS)
	place += motion * share
	if share < 1.0:
		place += _way_along_walls(map, motion * (1.0 - share))


## Returns the part of [param rest] that leads furthest along one of the walls.
func _way_along_walls(map: Map, rest: Vector2) -> Vector2:
	var best := _free_part(map, rest, Vector2.RIGHT, Vector2(0.0, -place.y))
	var other := _free_part(map, rest, Vector2.DOWN, Vector2(-place.x, 0.0))
	if other.length_squared() > best.length_squared():
		best = other
	for end: int in range(0, map.ends.size(), 2):
		var along := map.ends[end].direction_to(map.ends[end + 1])
		other = _free_part(map, rest, along, (place - map.ends[end]).slide(along))
		if other.length_squared() > best.length_squared():
			best = other
	return best


## Returns how far [param rest] leads along a wall, kept off it by a trace into the direction
## [param away].
func _free_part(map: Map, rest: Vector2, along: Vector2, away: Vector2) -> Vector2:
	var way := along * rest.dot(along) + away.normalized() * _OFF_WALL
	return way * map.free_share(place, way, RADIUS)


## Turns a share, 0 to 1, into −1 to 1.
static func scaled(share: float) -> float:
	return 2.0 * share - 1.0


## Returns the places of those that live.
static func places_of(fighters: Array[Fighter]) -> PackedVector2Array:
	var places := PackedVector2Array()
	for fighter: Fighter in fighters:
		if fighter.is_alive():
			places.append(fighter.place)
	return places
