extends "res://examples/zombies/fighter.gd"
## The soldier: a rifle with a magazine, delays between shots and for reloading.

## Numbers of an action: move x and y, rotation, shoot, reload.
const ACTION_SIZE := 5
## Rotation, rays to walls and enemies, place, health, pain, ammunition, both delays.
const SENSES_SIZE := 1 + 2 * NUM_RAYS + 4 + 3
## Pixels in a step for each unit of its action: its radius.
const STEP_LENGTH := RADIUS
## Ammunition in a magazine, and what a shot takes of it.
const MAGAZINE := 0.2
const SHOT := 0.01
const NUM_SHOTS := 20
const FIRE_DELAY := 2
const RELOAD_DELAY := 10
const DAMAGE := 0.35
## The shot is a circle of this radius, pixels.
const SHOT_RADIUS := RAY_WIDTH

## Shots left in the magazine; each is [constant SHOT] of ammunition.
var num_shots: int = NUM_SHOTS
## Steps until it can shoot again, and until it has reloaded.
var fire_delay: int = 0
var reload_delay: int = 0
## Whether it shot in this step, and where the shot began and ended.
var has_shot: bool = false
var shot_start := Vector2.ZERO
var shot_end := Vector2.ZERO


func _init() -> void:
	super(SENSES_SIZE, ACTION_SIZE)


## Begins an episode with a full magazine.
func begin(at: Vector2, looking: float) -> void:
	super(at, looking)
	num_shots = NUM_SHOTS
	fire_delay = 0
	reload_delay = 0
	has_shot = false


## Whether a shot would go off.
func can_shoot() -> bool:
	return is_alive() and num_shots > 0 and fire_delay == 0 and reload_delay == 0


## Shoots or reloads as its action says. Returns the enemy that was hit, or null.
func use_rifle(map: Map, enemies: Array[Fighter]) -> Fighter:
	_wait_a_step()
	has_shot = action[3] > 0.0 and can_shoot()
	if has_shot:
		num_shots -= 1
		fire_delay = FIRE_DELAY
		return shoot(map, enemies)
	if action[4] > 0.0 and reload_delay == 0 and num_shots < NUM_SHOTS and is_alive():
		reload_delay = RELOAD_DELAY
	return null


## Casts a circle straight ahead until a wall or a living enemy, which is returned.
func shoot(map: Map, enemies: Array[Fighter]) -> Fighter:
	var way := Vector2.from_angle(rotation) * SIGHT
	var share := map.free_share(place, way, SHOT_RADIUS)
	var hit: Fighter = null
	for enemy: Fighter in enemies:
		var entry := Map.circle_entry(enemy.place - place, way, RADIUS + SHOT_RADIUS)
		if enemy.is_alive() and entry < share:
			share = entry
			hit = enemy
	shot_start = place
	shot_end = place + way * share
	return hit


## Observes.
func observe(map: Map, enemies: PackedVector2Array) -> void:
	var senses := sense(map, enemies, [], 2)
	senses.append(scaled(num_shots * SHOT / MAGAZINE))
	senses.append(scaled(float(fire_delay) / FIRE_DELAY))
	senses.append(scaled(float(reload_delay) / RELOAD_DELAY))
	remember(senses)


func _wait_a_step() -> void:
	fire_delay = maxi(fire_delay - 1, 0)
	if reload_delay > 0:
		reload_delay -= 1
		if reload_delay == 0:
			num_shots = NUM_SHOTS
