extends "res://examples/zombies/fighter.gd"
## A zombie: half as fast as the soldier, and it bites.

## Numbers of an action: move x and y, rotation.
const ACTION_SIZE := 3
## Rotation, rays to walls, enemies and friends, place, health, pain.
const SENSES_SIZE := 1 + 3 * NUM_RAYS + 4
## Pixels in a step for each unit of its action: half its radius.
const STEP_LENGTH := RADIUS / 2.0
const DAMAGE := 0.05
## Farthest bite, from centre to centre, pixels.
const BITE := 50.0 + RADIUS

## Whether it bit in this step.
var has_bitten: bool = false


func _init() -> void:
	super(SENSES_SIZE, ACTION_SIZE)


## Begins an episode.
func begin(at: Vector2, looking: float) -> void:
	super(at, looking)
	has_bitten = false


## Bites an enemy in reach that no wall protects.
func bite(map: Map, enemy: Fighter) -> void:
	var is_near := place.distance_squared_to(enemy.place) <= BITE * BITE
	has_bitten = is_alive() and is_near and map.is_clear(place, enemy.place)
	if has_bitten:
		enemy.suffer(DAMAGE)


## Observes.
func observe(map: Map, enemies: PackedVector2Array, friends: PackedVector2Array) -> void:
	remember(sense(map, enemies, friends, 3))
