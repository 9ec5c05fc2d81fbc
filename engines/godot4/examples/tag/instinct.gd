extends RefCounted
## How chaser and runner move when neither a trainer nor a person steers them: each looks a moment
## ahead in sixteen directions and takes the best one that is free.

const Body := preload("res://examples/tag/body.gd")
const NUM_DIRECTIONS := 16
## How far they look ahead, seconds.
const FORESIGHT_S := 0.3


## Returns the direction that leads nearest to a place in pixels; nothing if none is free.
static func nearest_to(body: Body, goal: Vector2) -> Vector2:
	return _best(body, goal, -1.0)


## Returns the direction that leads farthest from a place in pixels; nothing if none is free.
static func farthest_from(body: Body, danger: Vector2) -> Vector2:
	return _best(body, danger, 1.0)


static func _best(body: Body, place: Vector2, sign_of_distance: float) -> Vector2:
	var best := Vector2.ZERO
	var best_score := -INF
	for i: int in NUM_DIRECTIONS:
		var wish := Vector2.from_angle(TAU * i / NUM_DIRECTIONS)
		var ahead := body.position + wish * body.max_speed * FORESIGHT_S
		if not body.game.is_free(ahead, body.radius):
			continue
		var score := sign_of_distance * ahead.distance_to(place)
		if score > best_score:
			best_score = score
			best = wish
	return best
