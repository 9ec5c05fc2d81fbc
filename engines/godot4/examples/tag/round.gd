extends RefCounted
## One round of tag: the pillars, the clock, and who has won.
##
## Chaser and runner share it. The first of them to be reset begins a round for both.

## Half the side of the square that the bodies' outlines stay in, pixels.
const HALF_SIDE := 320.0
const NUM_PILLARS := 5
## Smallest and largest radius of a pillar, pixels.
const PILLAR_RADIUS := Vector2(32.0, 48.0)
## Pillars stand in the middle and this far from it along both axes, pixels.
const PILLAR_OFFSET := 165.0
## How far a pillar may stand from there along each axis, pixels. Chaser and runner fit between any
## two pillars, and between a pillar and a wall.
const PILLAR_SPREAD := 30.0
## Nothing starts nearer to a wall or pillar than this, pixels.
const CLEARANCE := 30.0
## Chaser and runner start at least this far apart, pixels.
const START_GAP := 260.0
## Chaser and runner touch when their centres are this close, pixels.
const CATCH_GAP := 34.0
## Chaser's reward for a catch, and its loss when the time is up.
const WIN_REWARD := 1.0
## Chaser's reward for coming nearer, per pixel: 0.2 for the whole side.
const NEARER_REWARD := 0.2 / (2.0 * HALF_SIDE)

## Counts the rounds.
var number: int = 0
## Whether the runner is caught or the time is up.
var is_over: bool = true
## Whether the runner is caught.
var is_caught: bool = false
## Ticks until the runner has got away.
var ticks_left: int = 0
## Ticks of the whole round.
var num_ticks: int = 1
## Centres of the pillars: the middle one, then one for each quarter. Pixels.
var pillars := PackedVector2Array()
## Their radii, pixels.
var radii := PackedFloat32Array()
## Where the chaser and where the runner begins, pixels.
var starts := PackedVector2Array([Vector2.ZERO, Vector2.ZERO])

var _gap: float = 0.0


## Draws pillars and places for a round of [param ticks].
func begin(rng: RandomNumberGenerator, ticks: int) -> void:
	number += 1
	is_over = false
	is_caught = false
	num_ticks = ticks
	ticks_left = ticks
	_draw_pillars(rng)
	starts[0] = _random_place(rng)
	starts[1] = _random_place(rng)
	while starts[0].distance_to(starts[1]) < START_GAP:
		starts[1] = _random_place(rng)
	_gap = starts[0].distance_to(starts[1])


## Lets a tick pass in which both have moved. Returns what it was worth to the chaser; the runner
## gets the opposite.
func advance(chaser_place: Vector2, runner_place: Vector2) -> float:
	var gap := chaser_place.distance_to(runner_place)
	var reward := (_gap - gap) * NEARER_REWARD
	_gap = gap
	ticks_left -= 1
	if gap < CATCH_GAP:
		is_caught = true
		is_over = true
		return reward + WIN_REWARD
	if ticks_left <= 0:
		is_over = true
		return reward - WIN_REWARD
	return reward


## Returns the share of the round that is left, 0 … 1.
func time_left() -> float:
	return float(ticks_left) / num_ticks


## Returns whether a circle at [param place] is clear of walls and pillars, pixels.
func is_free(place: Vector2, radius: float) -> bool:
	var reach := HALF_SIDE - radius
	if absf(place.x) > reach or absf(place.y) > reach:
		return false
	for i: int in NUM_PILLARS:
		if place.distance_to(pillars[i]) < radii[i] + radius:
			return false
	return true


func _draw_pillars(rng: RandomNumberGenerator) -> void:
	pillars.clear()
	radii.clear()
	for i: int in NUM_PILLARS:
		var spread := Vector2(rng.randf_range(-1.0, 1.0), rng.randf_range(-1.0, 1.0))
		pillars.append(_pillar_centre(i) + spread * PILLAR_SPREAD)
		radii.append(rng.randf_range(PILLAR_RADIUS.x, PILLAR_RADIUS.y))


func _random_place(rng: RandomNumberGenerator) -> Vector2:
	while true:
		var share := Vector2(rng.randf_range(-1.0, 1.0), rng.randf_range(-1.0, 1.0))
		if is_free(share * HALF_SIDE, CLEARANCE):
			return share * HALF_SIDE
	return Vector2.ZERO


static func _pillar_centre(i: int) -> Vector2:
	if i == 0:
		return Vector2.ZERO
	return Vector2(-1.0 if i % 2 == 1 else 1.0, -1.0 if i <= 2 else 1.0) * PILLAR_OFFSET
