extends "ludus_test.gd"
## The rules of the example "find_coin".

const LudusManualPlay := preload("res://addons/ludus/bridge/manual_play.gd")

const FindCoin := preload("res://examples/find_coin/find_coin.gd")
const Map := preload("res://examples/shared/walled_map.gd")
const Walker := preload("res://examples/shared/walker.gd")

const SCENE := preload("res://examples/find_coin/find_coin.tscn")

const SIZE := FindCoin.SENSES_SIZE
const NUM_ROUNDS := 200


func test_rounds_begin_apart_with_one_wall_and_all_free() -> void:
	var game := _game(1)
	for i: int in NUM_ROUNDS:
		game.begin_episode()
		equal(game.map.ends.size(), 2, "ends of walls")
		var gap := game.hero.place.distance_to(game.target.place)
		check(gap >= Map.RADIUS, "round %d: %f apart" % [i, gap])
		for walker: Walker in [game.hero, game.target]:
			check(game.map.is_free(walker.place, Walker.RADIUS), "start at %s" % walker.place)


func test_hero_moves_20_and_the_target_24_and_both_look_where_they_go() -> void:
	var game := _open_game()
	_step(game, Vector2(0.5, 0.0), Vector2(0.0, -1.0))
	check(game.hero.place.is_equal_approx(Vector2(-90.0, 0.0)), "hero at %s" % game.hero.place)
	check(game.target.place.is_equal_approx(Vector2(200.0, -24.0)), "at %s" % game.target.place)
	check(is_equal_approx(game.hero.rotation, 0.0), "hero looks right")
	check(is_equal_approx(game.target.rotation, -PI / 2.0), "target looks up")
	_step(game, Vector2.ZERO, Vector2(-3.0, 0.0))
	check(is_equal_approx(game.hero.rotation, 0.0), "who stands goes on looking")
	check(game.target.place.is_equal_approx(Vector2(176.0, -24.0)), "a unit at most")


func test_walls_shorten_a_move() -> void:
	var game := _open_game()
	game.map.add_wall(Vector2(-70.0, -80.0), Vector2(-70.0, 80.0))
	for i: int in 3:
		_step(game, Vector2.RIGHT, Vector2.RIGHT)
	var reach := -70.0 - Walker.RADIUS - Map.THICKNESS / 2.0
	check(absf(game.hero.place.x - reach) < 0.02, "hero at %s" % game.hero.place)
	var edge := Map.RADIUS - Walker.RADIUS
	check(absf(game.target.place.x - edge) < 0.02, "target at %s" % game.target.place)


func test_a_touch_ends_the_round_and_turns_the_scores() -> void:
	var game := _open_game()
	_step(game, Vector2.ZERO, Vector2.ZERO)
	equal([game.get_reward(0), game.get_reward(1)], [-1.0, 1.0], "a step")
	equal([game.get_reward(0), game.get_reward(1)], [0.0, 0.0], "rewards are given once")
	game.target.place = game.hero.place + Vector2(60.0, 0.0)
	_step(game, Vector2.RIGHT, Vector2.ZERO)
	check(game.is_done(0) and game.is_done(1), "touch at 40 pixels")
	equal([game.get_reward(0), game.get_reward(1)], [1.0, -1.0], "contact")
	var place := game.hero.place
	_step(game, Vector2.LEFT, Vector2.LEFT)
	equal(game.hero.place, place, "nobody moves after the end")


func test_a_near_miss_goes_on() -> void:
	var game := _open_game()
	game.target.place = game.hero.place + Vector2(60.1, 0.0)
	_step(game, Vector2.RIGHT, Vector2.ZERO)
	check(not game.is_done(0), "40.1 pixels")


func test_a_step_lasts_one_tick_and_waits_for_actions() -> void:
	var game := _open_game()
	_step(game, Vector2.RIGHT, Vector2.ZERO)
	var place := game.hero.place
	game.advance()
	equal([game.hero.place, game.num_steps], [place, 1], "a tick without actions")


func test_what_is_observed() -> void:
	var game := _open_game()
	_step(game, Vector2.RIGHT, Vector2.UP * 0.001)
	var seen: PackedFloat32Array = game.get_observation(0)
	equal(seen.size(), 21 + 10 * 21 + 10 * 2, "size")
	equal(seen[0], 0.0, "rotation")
	check(is_equal_approx(seen[1], 330.0 / 700.0), "wall straight ahead: %f" % seen[1])
	check(is_equal_approx(seen[10], (280.0 - 20.0) / 700.0), "target ahead: %f" % seen[10])
	for i: int in range(11, 19):
		equal(seen[i], 1.0, "ray %d past the target" % i)
	check(is_equal_approx(seen[19], -80.0 / 250.0), "x: %f" % seen[19])
	equal(seen[20], 0.0, "y")
	seen = game.get_observation(1)
	check(is_equal_approx(seen[0], -0.5), "rotation of the target: %f" % seen[0])


func test_rays_have_the_angles_they_should() -> void:
	var game := _open_game()
	game.hero.place = Vector2.ZERO
	_step(game, Vector2.RIGHT * 0.0001, Vector2.ZERO)
	var seen: PackedFloat32Array = game.get_observation(0)
	var angles: Array[float] = [0.0, 0.1, -0.1, 0.21, -0.21, 0.33, -0.33, 0.45, -0.45]
	for i: int in angles.size():
		var way := Vector2.from_angle(angles[i] * PI).abs()
		var expected := Map.RADIUS / maxf(way.x, way.y) / 700.0
		check(
			absf(seen[1 + i] - expected) < 1e-5, "ray %d: %f, not %f" % [i, seen[1 + i], expected]
		)


func test_who_is_behind_a_wall_is_hidden() -> void:
	var game := _open_game()
	game.map.add_wall(Vector2(100.0, -80.0), Vector2(100.0, 80.0))
	_step(game, Vector2.RIGHT, Vector2.ZERO)
	var seen: PackedFloat32Array = game.get_observation(0)
	equal(seen[10], 1.0, "hidden")
	check(is_equal_approx(seen[1], (180.0 - 2.5) / 700.0), "the wall: %f" % seen[1])


func test_who_touches_is_felt_on_all_rays() -> void:
	var game := _open_game()
	game.target.place = game.hero.place + Vector2(-30.0, 0.0)
	_step(game, Vector2.ZERO, Vector2.ZERO)
	var seen: PackedFloat32Array = game.get_observation(0)
	for i: int in FindCoin.NUM_RAYS:
		check(is_equal_approx(seen[10 + i], 0.2 * 30.0 / 700.0), "ray %d: %f" % [i, seen[10 + i]])


func test_ten_steps_are_remembered_newest_first() -> void:
	var game := _game(4)
	var before: Array[PackedFloat32Array] = []
	var actions: Array[Vector2] = []
	var rng := RandomNumberGenerator.new()
	rng.seed = 4
	for i: int in 14:
		var seen: PackedFloat32Array = game.get_observation(0)
		before.push_front(seen.slice(0, SIZE))
		actions.push_front(Vector2(rng.randf_range(-1.0, 1.0), rng.randf_range(-1.0, 1.0)))
		_step(game, actions[0], Vector2.ZERO)
		seen = game.get_observation(0)
		for k: int in 10:
			var senses := seen.slice(SIZE * (1 + k), SIZE * (2 + k))
			var done := Vector2(seen[11 * SIZE + 2 * k], seen[11 * SIZE + 2 * k + 1])
			var is_known := k < before.size()
			equal(senses, before[k] if is_known else _zeros(SIZE), "step %d, senses %d" % [i, k])
			equal(done, actions[k] if is_known else Vector2.ZERO, "step %d, action %d" % [i, k])
	game.begin_episode()
	var fresh: PackedFloat32Array = game.get_observation(0)
	equal(fresh.slice(SIZE), _zeros(10 * (SIZE + 2)), "a new round remembers nothing")


func test_a_handed_out_observation_never_changes() -> void:
	var game := _game(5)
	var seen: PackedFloat32Array = game.get_observation(0)
	var copy := seen.duplicate()
	_step(game, Vector2.RIGHT, Vector2.LEFT)
	equal(seen, copy, "observation")


func test_the_end_of_a_round_is_told_and_counted() -> void:
	var game := _open_game()
	var told: Array = []
	game.round_ended.connect(func(found: bool, steps: int) -> void: told.append([found, steps]))
	for i: int in FindCoin.NUM_ROUND_STEPS:
		_step(game, Vector2.ZERO, Vector2.ZERO)
	game.begin_episode()
	game.target.place = game.hero.place + Vector2(50.0, 0.0)
	_step(game, Vector2.RIGHT, Vector2.ZERO)
	equal(told, [[false, 60], [true, 1]] as Array, "ends")
	equal(game.num_found, 1, "found")


func test_by_hand_w_a_s_d_move_the_hero_and_with_shift_the_target() -> void:
	var host := SCENE.instantiate() as LudusSimulationHost
	add(host)
	var game := host.simulation as FindCoin
	var play := LudusManualPlay.new()
	_tick(play, host)
	game.map.clear()
	for is_shifted: bool in [false, true]:
		game.hero.begin(Vector2(-100.0, 0.0), 0.0)
		game.target.begin(Vector2(100.0, 0.0), 0.0)
		press(KEY_SHIFT, is_shifted)
		press(KEY_W, true)
		_tick(play, host)
		_tick(play, host)
		press(KEY_W, false)
		check((game.hero.place.y < -15.0) != is_shifted, "hero at %s" % game.hero.place)
		check((game.target.place.y < -15.0) == is_shifted, "target at %s" % game.target.place)
	press(KEY_SHIFT, false)


func test_by_hand_rounds_follow_each_other() -> void:
	var host := SCENE.instantiate() as LudusSimulationHost
	add(host)
	var game := host.simulation as FindCoin
	var play := LudusManualPlay.new()
	for i: int in 3 * (FindCoin.NUM_ROUND_STEPS + 2):
		_tick(play, host)
	check(game.num_rounds >= 3, "rounds: %d" % game.num_rounds)
	check(game.num_steps <= FindCoin.NUM_ROUND_STEPS, "steps: %d" % game.num_steps)
	equal(game.status()["Found"], "0 of %d" % (game.num_rounds - 1), "the panel")


func _tick(play: LudusManualPlay, host: LudusSimulationHost) -> void:
	play.advance()
	host._physics_process(1.0 / 60.0)


## Both in the open, far apart on the x axis.
func _open_game() -> FindCoin:
	var game := _game(2)
	game.map.clear()
	game.hero.begin(Vector2(-100.0, 0.0), 0.0)
	game.target.begin(Vector2(200.0, 0.0), 0.0)
	return game


func _game(seed_value: int) -> FindCoin:
	var world := LudusWorld.new()
	add(world)
	world.set_seed(seed_value)
	world.begin_episode()
	var game := FindCoin.new()
	game.world = world
	game.create()
	game.begin_episode()
	return game


func _step(game: FindCoin, hero: Vector2, target: Vector2) -> void:
	game.apply_action(0, PackedFloat32Array([hero.x, hero.y]))
	game.apply_action(1, PackedFloat32Array([target.x, target.y]))
	game.advance()


func _zeros(count: int) -> PackedFloat32Array:
	var zeros := PackedFloat32Array()
	zeros.resize(count)
	return zeros
