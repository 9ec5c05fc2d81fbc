extends "ludus_test.gd"
## The geometry of "find_coin" and "zombies" against brute force.

const Map := preload("res://examples/shared/walled_map.gd")

const RADIUS := 20.0
## What a moved circle keeps from walls, pixels.
const GAP := 0.01
const NUM_MAPS := 60
const NUM_TRIES := 40
## Brute force walks in steps so small, pixels.
const INCH := 0.02


func test_inner_walls_leave_a_passage_everywhere() -> void:
	var rng := _rng(1)
	var num_walls := 0
	for i: int in NUM_MAPS:
		var map := _map(rng, 4)
		num_walls += map.ends.size() / 2
		for k: int in range(0, map.ends.size(), 2):
			var length := map.ends[k].distance_to(map.ends[k + 1])
			check(length > Map.SHORTEST_WALL - 0.01, "length %f" % length)
			for end: Vector2 in [map.ends[k], map.ends[k + 1]]:
				var room := Map.RADIUS - maxf(absf(end.x), absf(end.y)) - Map.THICKNESS / 2.0
				check(room > 2.0 * RADIUS, "passage at %s: %f" % [end, room])
	check(num_walls > 3 * NUM_MAPS, "walls: %d" % num_walls)


func test_a_moved_circle_stops_where_brute_force_stops() -> void:
	var rng := _rng(2)
	var num_stopped := 0
	for i: int in NUM_MAPS:
		var map := _map(rng, 1 + i % 4)
		for k: int in NUM_TRIES:
			var place := map.free_place(rng, RADIUS, [], 0.0)
			var motion := Vector2.from_angle(rng.randf() * TAU) * rng.randf_range(1.0, 300.0)
			var length := motion.length() * map.free_share(place, motion, RADIUS)
			var expected := _walk(map, place, motion, RADIUS + GAP)
			num_stopped += int(length < motion.length())
			var end := place + motion.normalized() * length
			if _is_off(map, end, length, expected, RADIUS + GAP):
				check(false, "from %s by %s: %f, not %f" % [place, motion, length, expected])
	check(num_stopped > NUM_MAPS * NUM_TRIES / 3, "stopped: %d" % num_stopped)


func test_a_circle_pushed_around_for_long_never_enters_a_wall() -> void:
	var rng := _rng(3)
	for i: int in 20:
		var map := _map(rng, 4)
		var place := map.free_place(rng, RADIUS, [], 0.0)
		var way := Vector2.RIGHT
		for k: int in 2000:
			if k % 7 == 0:
				way = Vector2.from_angle(rng.randf() * TAU) * 28.0
			place = map.move(place, way, RADIUS)
			if not map.is_free(place, RADIUS):
				check(false, "map %d, step %d: in a wall at %s" % [i, k, place])
				return
	check(true, "")


func test_a_circle_at_a_wall_can_leave_it_and_slide_along_it() -> void:
	var map := Map.new()
	map.add_wall(Vector2(-100.0, 0.0), Vector2(100.0, 0.0))
	var place := map.move(Vector2(0.0, -60.0), Vector2(0.0, 100.0), RADIUS)
	check(absf(place.y + RADIUS + Map.THICKNESS / 2.0) < 0.02, "stops at %s" % place)
	check(map.move(place, Vector2(0.0, 50.0), RADIUS).is_equal_approx(place), "no way through")
	equal(map.free_share(place, Vector2(50.0, 0.0), RADIUS), 1.0, "along")
	equal(map.free_share(place, Vector2(10.0, -50.0), RADIUS), 1.0, "away")


func test_rays_end_where_brute_force_ends() -> void:
	var rng := _rng(4)
	var num_inner := 0
	for i: int in NUM_MAPS:
		var map := _map(rng, 1 + i % 4)
		var place := map.free_place(rng, RADIUS, [], 0.0)
		var directions := PackedVector2Array(
			[Vector2.RIGHT, Vector2.UP, Vector2.LEFT, Vector2.DOWN]
		)
		for k: int in NUM_TRIES:
			directions.append(Vector2.from_angle(rng.randf() * TAU))
		var found := map.distances(place, directions)
		for k: int in directions.size():
			var expected := _walk(map, place, directions[k] * 800.0, 0.0)
			var end := place + directions[k] * found[k]
			num_inner += int(maxf(absf(end.x), absf(end.y)) < Map.RADIUS - 1.0)
			if _is_off(map, end, found[k], expected, 0.0):
				check(
					false, "from %s to %s: %f, not %f" % [place, directions[k], found[k], expected]
				)
	check(num_inner > NUM_MAPS * NUM_TRIES / 5, "rays to inner walls: %d" % num_inner)


func test_only_inner_walls_between_block_a_clear_line() -> void:
	var map := Map.new()
	map.add_wall(Vector2(-50.0, 0.0), Vector2(50.0, 0.0))
	check(not map.is_clear(Vector2(0.0, -40.0), Vector2(10.0, 40.0)), "across")
	check(map.is_clear(Vector2(0.0, -40.0), Vector2(10.0, -4.0)), "before it")
	check(map.is_clear(Vector2(60.0, -40.0), Vector2(60.0, 40.0)), "past it")


func test_a_circle_is_entered_in_front_only() -> void:
	equal(Map.circle_entry(Vector2(50.0, 0.0), Vector2(100.0, 0.0), 10.0), 0.4, "straight on")
	equal(Map.circle_entry(Vector2(50.0, 0.0), Vector2(-100.0, 0.0), 10.0), INF, "behind")
	equal(Map.circle_entry(Vector2(50.0, 11.0), Vector2(100.0, 0.0), 10.0), INF, "past it")
	equal(Map.circle_entry(Vector2(5.0, 0.0), Vector2(100.0, 0.0), 10.0), 0.0, "from inside")


## Whether [param length] differs from brute force by more than its step; a graze may go either way.
func _is_off(map: Map, end: Vector2, length: float, expected: float, radius: float) -> bool:
	if absf(length - expected) <= 2.0 * INCH:
		return false
	return map.is_free(end, radius + INCH) or not map.is_free(end, radius - INCH)


func _walk(map: Map, place: Vector2, motion: Vector2, radius: float) -> float:
	var way := motion.normalized()
	var length := 0.0
	# In long strides as long as there is room for one in every direction.
	while length < motion.length():
		var stride := 16.0
		while stride > INCH and not map.is_free(place + way * length, radius + stride):
			stride /= 2.0
		stride = maxf(stride, INCH)
		if not map.is_free(place + way * (length + stride), radius):
			return length
		length += stride
	return motion.length()


func _map(rng: RandomNumberGenerator, num_walls: int) -> Map:
	var map := Map.new()
	map.build(rng, num_walls)
	return map


func _rng(seed_value: int) -> RandomNumberGenerator:
	var rng := RandomNumberGenerator.new()
	rng.seed = seed_value
	return rng
