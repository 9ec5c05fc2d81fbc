extends "ludus_test.gd"
## The rules of the example "zombies".

const LudusManualPlay := preload("res://addons/ludus/bridge/manual_play.gd")

const Fighter := preload("res://examples/zombies/fighter.gd")
const Map := preload("res://examples/shared/walled_map.gd")
const Soldier := preload("res://examples/zombies/soldier.gd")
const Zombie := preload("res://examples/zombies/zombie.gd")
const Zombies := preload("res://examples/zombies/zombies.gd")

const SCENE := preload("res://examples/zombies/zombies.tscn")

const NUM_ROUNDS := 200
const STAND: Array[float] = [0.0, 0.0, 0.0, 0.0, 0.0]
const SHOOT: Array[float] = [0.0, 0.0, 0.0, 1.0, 0.0]
const RELOAD: Array[float] = [0.0, 0.0, 0.0, 0.0, 1.0]


func test_rounds_begin_apart_with_one_to_four_walls() -> void:
	var game := _game(1)
	var counts := {}
	for i: int in NUM_ROUNDS:
		game.begin_episode()
		counts[game.map.ends.size() / 2] = true
		for zombie: Zombie in game.zombies:
			var gap := zombie.place.distance_to(game.soldier.place)
			check(gap >= Zombies.START_DISTANCE, "round %d: %f apart" % [i, gap])
			check(game.map.is_free(zombie.place, Fighter.RADIUS), "zombie at %s" % zombie.place)
	var found := counts.keys()
	found.sort()
	equal(found, [1, 2, 3, 4], "numbers of walls")


func test_the_soldier_walks_a_radius_and_zombies_half_of_it_and_all_turn() -> void:
	var game := _open_game()
	_step(game, [1.0, 0.0, 0.5, 0.0, 0.0], [0.0, -1.0, -0.25])
	check(game.soldier.place.is_equal_approx(Vector2(-80.0, 0.0)), "%s" % game.soldier.place)
	check(is_equal_approx(game.soldier.rotation, PI / 2.0), "soldier looks down")
	check(
		game.zombies[0].place.is_equal_approx(Vector2(150.0, -10.0)), "%s" % game.zombies[0].place
	)
	check(is_equal_approx(game.zombies[0].rotation, -PI / 4.0), "zombie looks up")


func test_rotation_is_a_turn_or_an_angle_of_the_room() -> void:
	for way: String in ["turn", "angle"]:
		var game := _open_game()
		game.world.parameters = {"rotation": way}
		game.begin_episode()
		game.soldier.begin(Vector2.ZERO, 0.75 * PI)
		_step(game, [0.0, 0.0, 0.5, 0.0, 0.0])
		var expected := -0.75 * PI if way == "turn" else 0.5 * PI
		check(
			is_equal_approx(game.soldier.rotation, expected),
			"%s: %f" % [way, game.soldier.rotation]
		)


func test_shots_come_before_turns_and_steps() -> void:
	var game := _open_game()
	_step(game, [0.0, 1.0, 0.5, 1.0, 0.0], [0.0, 1.0, 0.0])
	check(is_equal_approx(game.zombies[0].health, 0.65), "health %f" % game.zombies[0].health)


func test_who_walks_into_a_wall_goes_on_along_it() -> void:
	var game := _open_game()
	game.map.add_wall(Vector2(-60.0, -80.0), Vector2(-60.0, 80.0))
	for y: float in [20.0, 40.0]:
		_step(game, [1.0, 1.0, 0.0, 0.0, 0.0])
		check(game.soldier.place.distance_to(Vector2(-82.5, y)) < 0.1, "%s" % game.soldier.place)
	_step(game, [1.0, 0.0, 0.0, 0.0, 0.0])
	check(game.soldier.place.distance_to(Vector2(-82.5, 40.0)) < 0.1, "%s" % game.soldier.place)


func test_nobody_gets_into_a_wall() -> void:
	var game := _game(3)
	for i: int in NUM_ROUNDS:
		game.begin_episode()
		for step: int in 30:
			var way := game.world.rng.randf_range(-PI, PI)
			_step(game, [2.0 * cos(way), 2.0 * sin(way), 0.0, 0.0, 0.0])
			check(game.map.is_free(game.soldier.place, Fighter.RADIUS), "%s" % game.soldier.place)


func test_a_shot_hurts_the_first_zombie_in_its_way() -> void:
	var game := _open_game()
	_step(game, SHOOT)
	check(game.soldier.has_shot, "it shot")
	check(is_equal_approx(game.zombies[0].health, 0.65), "health %f" % game.zombies[0].health)
	equal(game.zombies[1].health, 1.0, "the one behind")
	check(is_equal_approx(game.soldier.shot_end.x, 150.0 - 25.0), "end %s" % game.soldier.shot_end)


func test_a_shot_is_a_circle_of_five_pixels() -> void:
	for y: float in [24.9, 25.1]:
		var game := _open_game()
		game.zombies[0].place.y = y
		game.zombies[1].place.y = 200.0
		_step(game, SHOOT)
		equal(game.zombies[0].health < 1.0, y < 25.0, "zombie %f beside the line" % y)


func test_walls_stop_shots() -> void:
	var game := _open_game()
	game.map.add_wall(Vector2(0.0, -80.0), Vector2(0.0, 80.0))
	_step(game, SHOOT)
	check(game.soldier.has_shot and game.zombies[0].health == 1.0, "the zombie is safe")
	check(absf(game.soldier.shot_end.x + 7.5) < 0.02, "end %s" % game.soldier.shot_end)


func test_the_dead_stop_no_shots_and_do_nothing() -> void:
	var game := _open_game()
	game.zombies[0].health = 0.0
	var place := game.zombies[0].place
	_step(game, SHOOT, [1.0, 0.0, 0.5])
	check(is_equal_approx(game.zombies[1].health, 0.65), "the one behind is hit")
	equal(game.zombies[0].place, place, "the dead do not walk")
	game.zombies[0].place = game.soldier.place + Vector2(45.0, 0.0)
	_step(game, STAND)
	equal(game.soldier.health, 1.0, "the dead do not bite")


func test_a_magazine_has_twenty_shots_two_steps_apart() -> void:
	var game := _open_game()
	game.soldier.rotation = PI
	var shots := PackedInt32Array()
	for i: int in 50:
		_step(game, SHOOT)
		if game.soldier.has_shot:
			shots.append(i)
	equal(shots, PackedInt32Array(range(0, 40, 2)), "steps with a shot")
	equal(game.soldier.num_shots, 0, "left")


func test_reloading_takes_ten_steps_and_fills_the_magazine() -> void:
	var game := _open_game()
	_step(game, RELOAD)
	equal(game.soldier.reload_delay, 0, "a full magazine is not changed")
	game.soldier.num_shots = 3
	_step(game, RELOAD)
	for i: int in 9:
		_step(game, SHOOT)
		check(not game.soldier.has_shot, "no shot while reloading, step %d" % i)
	equal(game.soldier.num_shots, 3, "not yet")
	_step(game, SHOOT)
	check(game.soldier.has_shot, "ready after ten steps")
	equal(game.soldier.num_shots, Soldier.NUM_SHOTS - 1, "full, less one")


func test_zombies_bite_within_seventy_pixels_but_not_through_walls() -> void:
	for gap: float in [69.9, 70.1]:
		var game := _open_game()
		game.zombies[0].place = game.soldier.place + Vector2(gap, 0.0)
		_step(game, STAND)
		equal(game.zombies[0].has_bitten, gap < 70.0, "at %f" % gap)
		equal(game.soldier.health < 1.0, gap < 70.0, "health at %f" % gap)
	var guarded := _open_game()
	guarded.zombies[0].place = guarded.soldier.place + Vector2(60.0, 0.0)
	var wall := guarded.soldier.place + Vector2(30.0, 0.0)
	guarded.map.add_wall(wall - Vector2(0.0, 70.0), wall + Vector2(0.0, 70.0))
	_step(guarded, STAND)
	equal(guarded.soldier.health, 1.0, "behind a wall")


func test_twenty_bites_kill_and_end_the_round() -> void:
	var game := _open_game()
	game.zombies[0].place = game.soldier.place + Vector2(60.0, 0.0)
	var total := 0.0
	for i: int in 20:
		check(not game.is_done(0), "alive before bite %d" % i)
		_step(game, STAND)
		total += game.get_reward(1)
	check(game.is_done(0) and game.is_done(1) and game.is_done(2), "all are done")
	equal(game.soldier.health, 0.0, "health")
	equal(game.zombie_score(), 10.0, "score of the zombies")
	check(absf(total - 20.0) < 1e-6, "return of a zombie: %f" % total)
	equal(game.get_reward(0), 0.0, "return of the soldier")
	equal(game.num_zombie_wins, 1, "wins")


func test_three_hits_kill_a_zombie_and_six_win_the_round() -> void:
	var game := _open_game()
	var total := 0.0
	for i: int in 11:
		check(not game.is_done(0), "step %d" % i)
		_step(game, SHOOT)
		total += game.get_reward(0)
	check(game.is_done(0) and game.is_done(2), "both are dead")
	equal(game.soldier_score(), 27.0, "score of the soldier")
	check(absf(total - 28.0) < 1e-5, "return of the soldier: %f" % total)
	equal(game.num_soldier_wins, 1, "wins")


func test_scores_follow_the_formulas() -> void:
	var game := _open_game()
	equal([game.soldier_score(), game.zombie_score()], [-1.0, -10.0], "at the start")
	game.zombies[0].health = 0.3
	game.soldier.health = 0.75
	check(is_equal_approx(game.soldier_score(), pow(2.0 * 0.7 - 1.0, 3.0)), "soldier")
	check(is_equal_approx(game.zombie_score(), 10.0 * (2.0 * 0.25 - 1.0)), "zombies")


func test_the_score_itself_is_rewarded_on_request() -> void:
	var game := _open_game()
	game.world.parameters = {"reward": "score"}
	game.begin_episode()
	for i: int in 2:
		_step(game, STAND)
		equal([game.get_reward(0), game.get_reward(1)], [-1.0, -10.0], "step %d" % i)


func test_what_is_observed() -> void:
	var game := _open_game()
	_step(game, SHOOT)
	var seen: PackedFloat32Array = game.get_observation(0)
	equal(seen.size(), 34 + 10 * (34 + 5), "size of the soldier's")
	check(is_equal_approx(seen[1], 350.0 / 700.0), "wall ahead: %f" % seen[1])
	check(is_equal_approx(seen[14], 225.0 / 700.0), "zombie ahead: %f" % seen[14])
	var rest := seen.slice(27, 34)
	var expected: Array[float] = [-0.4, 0.0, 1.0, -1.0, 0.9, 1.0, -1.0]
	for i: int in expected.size():
		check(is_equal_approx(rest[i], expected[i]), "number %d: %f" % [27 + i, rest[i]])
	seen = game.get_observation(1)
	equal(seen.size(), 44 + 10 * (44 + 3), "size of a zombie's")
	check(is_equal_approx(seen[14], 1.0), "looks away from the soldier: %f" % seen[14])
	check(is_equal_approx(seen[27], 25.0 / 700.0), "friend ahead: %f" % seen[27])
	check(is_equal_approx(seen[42], 2.0 * 0.65 - 1.0), "health: %f" % seen[42])
	check(is_equal_approx(seen[43], 2.0 * 0.35 - 1.0), "pain: %f" % seen[43])


func test_by_hand_zombies_come_and_space_shoots() -> void:
	var host := SCENE.instantiate() as LudusSimulationHost
	add(host)
	var game := host.simulation as Zombies
	var play := LudusManualPlay.new()
	_tick(play, host)
	_line_up(game)
	press(KEY_SPACE, true)
	press(KEY_D, true)
	_tick(play, host)
	_tick(play, host)
	press(KEY_SPACE, false)
	press(KEY_D, false)
	check(game.soldier.place.x > -85.0, "soldier at %s" % game.soldier.place)
	check(game.zombies[0].place.x < 145.0, "zombie at %s" % game.zombies[0].place)
	check(game.zombies[0].health < 1.0, "hit")


func _tick(play: LudusManualPlay, host: LudusSimulationHost) -> void:
	play.advance()
	host._physics_process(1.0 / 60.0)


func _open_game() -> Zombies:
	var game := _game(2)
	_line_up(game)
	return game


## Puts soldier and zombies on the x axis of a map without walls. All look right.
func _line_up(game: Zombies) -> void:
	game.map.clear()
	game.soldier.begin(Vector2(-100.0, 0.0), 0.0)
	game.zombies[0].begin(Vector2(150.0, 0.0), 0.0)
	game.zombies[1].begin(Vector2(200.0, 0.0), 0.0)


func _game(seed_value: int) -> Zombies:
	var world := LudusWorld.new()
	add(world)
	world.set_seed(seed_value)
	world.begin_episode()
	var game := Zombies.new()
	game.world = world
	game.create()
	game.begin_episode()
	return game


func _step(game: Zombies, soldier: Array[float], zombie: Array[float] = [0.0, 0.0, 0.0]) -> void:
	game.apply_action(0, PackedFloat32Array(soldier))
	game.apply_action(1, PackedFloat32Array(zombie))
	game.apply_action(2, PackedFloat32Array([0.0, 0.0, 0.0]))
	game.advance()
