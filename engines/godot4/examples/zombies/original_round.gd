extends RefCounted
## A round of "zombies" by the rules of godot-ai's game. All see, shoot and stop each other where
## they were when the step began.

const Fighter := preload("res://examples/zombies/fighter.gd")
const Map := preload("res://examples/shared/walled_map.gd")
const Original := preload("res://examples/shared/original_rules.gd")
const Rifle := preload("res://examples/zombies/original_rifle.gd")
const Soldier := preload("res://examples/zombies/soldier.gd")
const Zombie := preload("res://examples/zombies/zombie.gd")

const RAY_ANGLES: PackedFloat64Array = [
	0.0, 0.1, -0.1, 0.21, -0.21, 0.33, -0.33, 0.48, -0.48, 0.6, -0.6, 0.75, -0.75
]
## Rotation, rays to walls, enemies and friends, place, health and damage; then the rifle, or what
## zombies have in its place.
const NUM_SHARED := 1 + 3 * Fighter.NUM_RAYS + 4
const SOLDIER_SENSES := NUM_SHARED + 6
const ZOMBIE_SENSES := NUM_SHARED + 4
## A magazine, its size, the delay of reloading and its length: a zombie never uses them.
const ZOMBIE_RIFLE: PackedFloat32Array = [0.01, 0.01, 0.0, 0.1]
## Where the ray straight ahead to enemies lies among the senses.
const AHEAD := 1 + Fighter.NUM_RAYS
## Numbers of the last actions that are remembered.
const NUM_ACTION_NUMBERS := 20
## Distance of two starts, pixels.
const START_DISTANCE := 4.0 * Fighter.RADIUS
## How far from its end a shot hits, pixels.
const SHOT_REACH := 10.0
## Above this product of a direction and a segment's normal, Godot takes a contact for one with the
## whole segment.
const EDGE_CONTACT := 0.99998
const MAX_WALLS := 4
const SHORTEST_WALL := 20.0
## How far a wall is from upright or level, pixels.
const SLANT := 20.0

var _map: Map
var _soldier: Soldier
var _zombies: Array[Zombie]
var _rifle := Rifle.new()


func _init(map: Map, soldier: Soldier, zombies: Array[Zombie]) -> void:
	_map = map
	_soldier = soldier
	_zombies = zombies
	map.half_thickness = 0.0
	map.gap = 0.0
	map.stops_overlapping = false


## Numbers in an observation.
static func observation_size(num_senses: int) -> int:
	return num_senses * (1 + Fighter.NUM_REMEMBERED) + NUM_ACTION_NUMBERS


## Begins a round.
func begin(rng: RandomNumberGenerator) -> void:
	_rifle = Rifle.new()
	_build_walls(rng)
	var places := PackedVector2Array()
	for fighter: Fighter in _fighters():
		var at := Original.draw_start(rng, _map, places, START_DISTANCE)
		fighter.begin(at, rng.randf_range(-PI, PI))
		places.append(at)
	observe([true, true, true])


## Makes a step: the soldier first, then each zombie that lives.
func advance() -> void:
	var acting: Array[bool] = []
	for fighter: Fighter in _fighters():
		acting.append(fighter.is_alive())
	var places: Array[Vector2] = [_soldier.place, _zombies[0].place, _zombies[1].place]
	if acting[0]:
		_act_soldier()
	for i: int in _zombies.size():
		acting[1 + i] = _zombies[i].is_alive()
		if acting[1 + i]:
			_act_zombie(_zombies[i], _zombies[1 - i], places[0], places[2 - i])
	observe(acting)


## Observes; who has not acted remembers nothing new.
func observe(acting: Array[bool]) -> void:
	var enemies := PackedVector2Array()
	for zombie: Zombie in _zombies:
		if zombie.is_alive():
			enemies.append(zombie.place)
	_observe(_soldier, enemies, [], Soldier.DAMAGE, _rifle.numbers(), not acting[0])
	var soldiers := PackedVector2Array([_soldier.place] if _soldier.is_alive() else [])
	for i: int in _zombies.size():
		var friend := _zombies[1 - i]
		var friends := PackedVector2Array([friend.place] if friend.is_alive() else [])
		_observe(_zombies[i], soldiers, friends, Zombie.DAMAGE, ZOMBIE_RIFLE, not acting[1 + i])


func _fighters() -> Array[Fighter]:
	return [_soldier, _zombies[0], _zombies[1]]


## By turns nearly upright and nearly level ones; some are too short to be built.
func _build_walls(rng: RandomNumberGenerator) -> void:
	_map.clear()
	for i: int in rng.randi_range(1, MAX_WALLS):
		var from := Original.draw_point(rng)
		var slant := rng.randf_range(-SLANT, SLANT)
		var along := rng.randf_range(-Original.REACH, Original.REACH)
		var to := Vector2(from.x + slant, along) if i % 2 == 0 else Vector2(along, from.y + slant)
		if from.distance_to(to) >= SHORTEST_WALL:
			_map.add_wall(from, to)


func _act_soldier() -> void:
	var enemies: Array[Fighter] = []
	var places := PackedVector2Array()
	for zombie: Zombie in _zombies:
		if zombie.is_alive():
			enemies.append(zombie)
			places.append(zombie.place)
	_rifle.wait()
	_soldier.has_shot = _soldier.action[3] > 0.0 and _rifle.shoot()
	if _soldier.has_shot:
		var hit := _shoot(enemies)
		if hit != null:
			hit.suffer(Soldier.DAMAGE)
	if _soldier.action[4] > 0.0:
		_rifle.reload()
	_soldier.num_shots = roundi(_rifle.ammunition / Rifle.SHOT)
	_soldier.reload_delay = roundi(_rifle.reload_delay / Rifle.STEP)
	_walk(_soldier, Soldier.STEP_LENGTH, places)


## Casts the shot, and returns what lies deepest within [constant SHOT_REACH] of where it ends: an
## enemy, at close quarters the soldier itself, or null for a wall. It passes whom it begins in.
func _shoot(enemies: Array[Fighter]) -> Fighter:
	var place := _soldier.place
	var ray := Vector2.from_angle(_soldier.rotation)
	var way := ray * Fighter.SIGHT
	var contact := Fighter.RADIUS + Soldier.SHOT_RADIUS
	var share := _map.free_share(place, way, Soldier.SHOT_RADIUS)
	for enemy: Fighter in enemies:
		if enemy.place.distance_to(place) >= contact:
			share = minf(share, Map.circle_entry(enemy.place - place, way, contact))
	_soldier.shot_start = place
	_soldier.shot_end = place + way * Original.cast(share) + ray * Soldier.SHOT_RADIUS
	var hit: Fighter = null
	var deepest := _wall_depth(_soldier.shot_end)
	for fighter: Fighter in enemies + [_soldier]:
		var distance := fighter.place.distance_to(_soldier.shot_end)
		var depth := Fighter.RADIUS + SHOT_REACH - distance
		if depth > maxf(deepest, 0.0):
			deepest = depth
			hit = fighter
	return hit


## Returns how deep the nearest wall lies within [constant SHOT_REACH] of a point, negative if none
## does. Beyond the end of a wall this is less than the distance says: Godot measures such contacts
## from the line through the wall, as the normal of [code]GodotSegmentShape2D[/code] is as long as
## the segment.
func _wall_depth(point: Vector2) -> float:
	var deepest := SHOT_REACH - Map.RADIUS + maxf(absf(point.x), absf(point.y))
	for i: int in range(0, _map.ends.size(), 2):
		var from := _map.ends[i]
		var to := _map.ends[i + 1]
		var way := Geometry2D.get_closest_point_to_segment(point, from, to) - point
		var depth := SHOT_REACH - way.length()
		var normal := (to - from).orthogonal()
		var along_normal := absf(way.normalized().dot(normal))
		if depth > 0.0 and along_normal > EDGE_CONTACT:
			depth *= along_normal / normal.length()
		deepest = maxf(deepest, depth)
	return deepest


## Bites what it runs into straight ahead, then turns and walks. It remembers what it senses now:
## who was shot is hurt or gone.
func _act_zombie(zombie: Zombie, friend: Zombie, soldier_at: Vector2, friend_at: Vector2) -> void:
	var soldiers := PackedVector2Array([soldier_at] if _soldier.is_alive() else [])
	var friends := PackedVector2Array([friend_at] if friend.is_alive() else [])
	_observe(zombie, soldiers, friends, Zombie.DAMAGE, ZOMBIE_RIFLE, true)
	zombie.has_bitten = zombie.observation[AHEAD] < Zombie.BITE / Fighter.SIGHT
	if zombie.has_bitten:
		_soldier.suffer(Zombie.DAMAGE)
	_walk(zombie, Zombie.STEP_LENGTH, soldiers + friends)


func _walk(fighter: Fighter, step: float, others: PackedVector2Array) -> void:
	var motion := Vector2(fighter.action[0], fighter.action[1]) * step
	fighter.rotation = Transform2D(fighter.action[2] * PI, Vector2.ZERO).get_rotation()
	fighter.place = Original.move(_map, fighter.place, motion, others)


func _observe(
	fighter: Fighter,
	enemies: PackedVector2Array,
	friends: PackedVector2Array,
	damage: float,
	rifle: PackedFloat32Array,
	is_idle: bool,
) -> void:
	var walls := Original.look(_map, fighter, RAY_ANGLES)
	var senses := PackedFloat32Array([fighter.rotation / PI])
	senses.append_array(walls)
	senses.append_array(Original.see(fighter, walls, enemies, true))
	senses.append_array(Original.see(fighter, walls, friends, false))
	senses.append(fighter.place.x / Map.RADIUS)
	senses.append(fighter.place.y / Map.RADIUS)
	senses.append(Fighter.scaled(fighter.health))
	senses.append(Fighter.scaled(damage))
	for number: float in rifle:
		senses.append(Fighter.scaled(number))
	Original.remember(fighter, senses, NUM_ACTION_NUMBERS, is_idle)
