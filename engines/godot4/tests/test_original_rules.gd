extends "ludus_test.gd"
## The rules of godot-ai's games, in the examples "find_coin" and "zombies" with rules = "original".

const FindCoin := preload("res://examples/find_coin/find_coin.gd")
const Fighter := preload("res://examples/zombies/fighter.gd")
const Map := preload("res://examples/shared/walled_map.gd")
const Original := preload("res://examples/shared/original_rules.gd")
const OriginalRound := preload("res://examples/zombies/original_round.gd")
const Walker := preload("res://examples/shared/walker.gd")
const Zombies := preload("res://examples/zombies/zombies.gd")

const FIND_COIN_SCENE := preload("res://examples/find_coin/original.tscn")
const ZOMBIES_SCENE := preload("res://examples/zombies/original.tscn")
const SIZE := FindCoin.SENSES_SIZE
const STAND: Array[float] = [0.0, 0.0, 0.0, 0.0, 0.0]
const SHOOT: Array[float] = [0.0, 0.0, 0.0, 1.0, 0.0]


func test_the_scenes_choose_the_rules() -> void:
	for scene: PackedScene in [FIND_COIN_SCENE, ZOMBIES_SCENE]:
		var root := scene.instantiate()
		check(Original.are_chosen(LudusWorld.find_in(root)), scene.resource_path)
		root.free()


func test_find_coin_begins_with_room_and_a_long_wall() -> void:
	var game := _find_coin()
	for i: int in 100:
		game.begin_episode()
		var ends := game.map.ends
		check(ends[0].distance_to(ends[1]) >= 0.5625 * Map.RADIUS, "wall %s" % ends)
		var places: Array[Vector2] = [game.hero.place, game.target.place]
		check(places[0].distance_to(places[1]) >= Map.RADIUS, "apart %s" % [places])
		for place: Vector2 in places + [ends[0], ends[1]]:
			check(maxf(absf(place.x), absf(place.y)) <= 187.5, "within reach %s" % place)
		for place: Vector2 in places:
			check(game.map.is_free(place, 60.0), "room around %s" % place)


func test_find_coin_remembers_the_first_senses_and_the_oldest_first() -> void:
	var game := _find_coin()
	var first := game.hero.observation.slice(0, SIZE)
	for i: int in 11:
		equal(game.hero.observation.slice(i * SIZE, (i + 1) * SIZE), first, "senses %d" % i)
	equal(game.hero.observation.slice(11 * SIZE), _zeros(20), "actions")
	_step_coin(game, Vector2(0.5, 0.25), Vector2.ZERO)
	var second := game.hero.observation.slice(0, SIZE)
	check(second != first, "it has moved")
	_step_coin(game, Vector2(-0.5, 0.0), Vector2.ZERO)
	equal(game.hero.observation.slice(10 * SIZE, 11 * SIZE), second, "newest last")
	equal(game.hero.observation.slice(9 * SIZE, 10 * SIZE), first, "before it")
	equal(game.hero.observation.slice(-4), PackedFloat32Array([0.5, 0.25, -0.5, 0.0]), "actions")


func test_bodies_look_with_all_of_their_width() -> void:
	var game := _find_coin()
	game.map.clear()
	_put(game.hero, Vector2(-100.0, 0.0))
	_put(game.target, Vector2(100.0, 35.0))
	game._sense()
	var senses := game.hero.observation
	near(senses[1], Original.cast(330.0 / 700.0), "wall ahead, from the edge of the body")
	near(senses[10], Original.cast((200.0 - sqrt(375.0)) / 700.0), "beside the middle ray")
	game.map.add_wall(Vector2(0.0, -100.0), Vector2(0.0, 100.0))
	game._sense()
	near(game.hero.observation[1], Original.cast(80.0 / 700.0), "a wall has no thickness")
	near(game.hero.observation[10], 1.0, "hidden")


func test_casts_end_where_those_of_the_physics_server_do() -> void:
	var space := PhysicsServer2D.space_create()
	var wall := PhysicsServer2D.segment_shape_create()
	var body := PhysicsServer2D.body_create()
	PhysicsServer2D.body_set_mode(body, PhysicsServer2D.BODY_MODE_STATIC)
	PhysicsServer2D.shape_set_data(wall, Rect2(0.0, -1000.0, 0.0, 1000.0))
	PhysicsServer2D.body_add_shape(body, wall)
	PhysicsServer2D.body_set_space(body, space)
	PhysicsServer2D.space_set_active(space, true)
	var query := PhysicsShapeQueryParameters2D.new()
	query.shape = CircleShape2D.new()
	(query.shape as CircleShape2D).radius = 20.0
	query.motion = Vector2(700.0, 0.0)
	for gap: float in [0.5, 1.0, 3.0, 10.0, 99.0, 333.0, 400.0, 650.0, 698.0, 701.0]:
		query.transform = Transform2D(0.0, Vector2(-20.0 - gap, 0.0))
		var found := PhysicsServer2D.space_get_direct_state(space).cast_motion(query)
		equal(Original.cast(gap / 700.0), found[0], "%f pixels before the wall" % gap)
	for rid: RID in [body, wall, space]:
		PhysicsServer2D.free_rid(rid)


func test_who_is_touched_is_felt() -> void:
	var game := _find_coin()
	game.map.clear()
	_put(game.hero, Vector2.ZERO)
	_put(game.target, Vector2(30.0, 0.0))
	game._sense()
	near(game.hero.observation[10], 0.2 * 10.0 / 700.0, "its edge is 10 pixels away")


func test_moves_keep_off_walls_and_standing_turns_to_zero() -> void:
	var game := _find_coin()
	game.map.clear()
	_put(game.hero, Vector2(220.0, 0.0))
	_put(game.target, Vector2(-100.0, 0.0))
	_step_coin(game, Vector2(1.0, 0.0), Vector2(0.0, -1.0))
	near(game.hero.place.x, 225.0, "25 pixels from the wall", 0.02)
	near(game.target.rotation, -PI / 2.0, "it goes up")
	_step_coin(game, Vector2.ZERO, Vector2.ZERO)
	near(game.target.rotation, 0.0, "who stands looks right")


func test_observations_of_zombies_have_their_size() -> void:
	var game := _zombies()
	equal(game.observation_entries("soldier")[0].shape, PackedInt32Array([570]), "soldier")
	equal(game.observation_entries("zombie")[0].shape, PackedInt32Array([548]), "zombie")
	for i: int in 3:
		_step_all(game, STAND)
		equal(game.get_observation(0).size(), 570, "soldier")
		equal(game.get_observation(1).size(), 548, "zombie")
	var senses: PackedFloat32Array = game.get_observation(0)
	# Health, damage, ammunition, magazine, delay and time of reloading, of firing, delay of firing.
	var expected: Array[float] = [1.0, 0.35, 0.2, 0.2, 0.0, 0.1, 0.02, 0.0]
	for i: int in 8:
		near(senses[42 + i], 2.0 * expected[i] - 1.0, "number %d" % i)


func test_zombies_begins_with_walls_by_turns_and_room() -> void:
	var game := _zombies()
	for i: int in 100:
		game.begin_episode()
		check(game.map.ends.size() <= 8, "four walls at most")
		var places: Array[Vector2] = [game.soldier.place]
		for zombie: Fighter in game.zombies:
			places.append(zombie.place)
		for j: int in 3:
			check(game.map.is_free(places[j], 60.0), "room around %s" % places[j])
			check(places[j].distance_to(places[j - 1]) >= 80.0, "apart %s" % [places])


func test_a_magazine_is_empty_after_19_shots_and_full_after_11_steps() -> void:
	var game := _duel(Vector2(-200.0, -200.0), Vector2(200.0, 200.0))
	var shots := 0
	for i: int in 38:
		_step_all(game, SHOOT)
		shots += int(game.soldier.has_shot)
	equal(shots, 19, "every other step")
	var steps := 0
	while not game.soldier.has_shot and steps < 40:
		_step_all(game, SHOOT)
		steps += 1
	equal(steps, 11, "the last step asked for a new magazine, which takes 11")


func test_shots_hit_where_the_soldier_looked_before_it_turned() -> void:
	var game := _duel(Vector2(-100.0, 0.0), Vector2(100.0, 0.0))
	_step_all(game, [0.0, 0.0, 0.5, 1.0, 0.0])
	near(game.zombies[0].health, 0.65, "hit")
	near(game.soldier.rotation, PI / 2.0, "an angle of the room")
	near(game.get_reward(0), pow(2.0 * 0.35 - 1.0, 3.0), "the score itself")
	near(game.get_reward(1), -10.0, "the score of the zombies")


func test_a_shot_passes_whom_it_begins_in_and_may_hit_the_soldier_itself() -> void:
	var game := _duel(Vector2(-100.0, 0.0), Vector2(-80.0, 0.0))
	game.zombies[1].place = Vector2(0.0, 0.0)
	_step_all(game, SHOOT)
	near(game.zombies[0].health, 1.0, "it stands where the shot begins")
	near(game.zombies[1].health, 0.65, "hit behind it")
	game = _duel(Vector2(-100.0, 0.0), Vector2(-72.0, 0.0))
	_step_all(game, SHOOT)
	near(game.zombies[0].health, 1.0, "8 pixels before its centre")
	near(game.soldier.health, 0.65, "it shot itself")


func test_a_shot_into_the_end_of_a_wall_hits_what_godot_finds_deepest() -> void:
	var num_own_hits := 0
	for slant: float in [0.0, 0.2, 2.0, 30.0]:
		for aside: float in [-1.0, -0.2, 0.0, 0.5, 3.0]:
			var game := _duel(Vector2(-100.0, 0.0), Vector2(200.0, 200.0))
			var wall: Array[Vector2] = [Vector2(-73.0, aside), Vector2(0.0, aside + slant)]
			game.map.add_wall(wall[0], wall[1])
			_step_all(game, SHOOT)
			var is_own_hit := game.soldier.health < 1.0
			num_own_hits += int(is_own_hit)
			var found := _is_body_deepest(Vector2(-100.0, 0.0), wall, game.soldier.shot_end)
			equal(is_own_hit, found, "wall %s" % [wall])
	check(num_own_hits > 0 and num_own_hits < 20, "%d of 20 hit the soldier" % num_own_hits)


func test_a_body_that_overlaps_a_wall_goes_through() -> void:
	var game := _duel(Vector2(-100.0, 0.0), Vector2(200.0, 200.0))
	game.map.add_wall(Vector2(-80.0, -50.0), Vector2(-80.0, 50.0))
	_step_all(game, [1.0, 0.0, 0.0, 0.0, 0.0])
	near(game.soldier.place.x, -80.0, "20 pixels away, it does not stop at 25")
	near(game.get_observation(0)[1], Original.cast(310.0 / 700.0), "nor does it see the wall")


func test_zombies_bite_only_what_is_ahead() -> void:
	var game := _duel(Vector2(-30.0, 0.0), Vector2(30.0, 0.0))
	_step_all(game, STAND, [0.0, 0.0, 1.0])
	near(game.soldier.health, 1.0, "it looked away")
	_step_all(game, STAND, [0.0, 0.0, 0.0])
	near(game.soldier.health, 0.95, "it looked at the soldier, and turns away now")
	_step_all(game, STAND)
	near(game.soldier.health, 0.95, "it looks away")


func test_bodies_stop_each_other() -> void:
	var game := _duel(Vector2(-25.0, 0.0), Vector2(25.0, 0.0))
	_step_all(game, [1.0, 0.0, 0.0, 0.0, 0.0])
	near(game.soldier.place.x, -20.0, "45 pixels between the centres", 0.02)
	var zombie := game.zombies[0]
	zombie.health = 0.0
	_step_all(game, [1.0, 0.0, 0.0, 0.0, 0.0])
	near(game.soldier.place.x, 0.0, "the dead stop nobody", 0.02)
	var remembered := zombie.observation.slice(OriginalRound.ZOMBIE_SENSES)
	_step_all(game, STAND)
	equal(zombie.observation.slice(OriginalRound.ZOMBIE_SENSES), remembered, "nor remember")


## A soldier that looks right and a zombie in an empty room; the other zombie is in a corner.
func _duel(soldier_at: Vector2, zombie_at: Vector2) -> Zombies:
	var game := _zombies()
	game.map.clear()
	_put(game.soldier, soldier_at)
	_put(game.zombies[0], zombie_at)
	_put(game.zombies[1], Vector2(-200.0, 200.0))
	return game


## Asks the physics server what is deepest within 10 pixels of a point: a body, rather than a wall?
func _is_body_deepest(at: Vector2, wall: Array[Vector2], point: Vector2) -> bool:
	var space := PhysicsServer2D.space_create()
	PhysicsServer2D.space_set_active(space, true)
	var shapes: Array[RID] = [
		PhysicsServer2D.segment_shape_create(), PhysicsServer2D.circle_shape_create()
	]
	PhysicsServer2D.shape_set_data(shapes[0], Rect2(wall[0], wall[1]))
	PhysicsServer2D.shape_set_data(shapes[1], Fighter.RADIUS)
	var bodies: Array[RID] = []
	for shape: RID in shapes:
		var body := PhysicsServer2D.body_create()
		PhysicsServer2D.body_set_mode(body, PhysicsServer2D.BODY_MODE_STATIC)
		PhysicsServer2D.body_add_shape(body, shape)
		PhysicsServer2D.body_set_space(body, space)
		bodies.append(body)
	var place := Transform2D(0.0, at)
	PhysicsServer2D.body_set_state(bodies[1], PhysicsServer2D.BODY_STATE_TRANSFORM, place)
	var query := PhysicsShapeQueryParameters2D.new()
	query.shape = CircleShape2D.new()
	(query.shape as CircleShape2D).radius = OriginalRound.SHOT_REACH / 2.0
	query.margin = OriginalRound.SHOT_REACH / 2.0
	query.transform = Transform2D(0.0, point)
	var found := PhysicsServer2D.space_get_direct_state(space).get_rest_info(query)
	for rid: RID in bodies + shapes + [space]:
		PhysicsServer2D.free_rid(rid)
	return found["rid"] == bodies[1]


func _put(walker: Walker, place: Vector2) -> void:
	walker.place = place
	walker.rotation = 0.0


func _find_coin() -> FindCoin:
	var game := FindCoin.new()
	_begin(game)
	return game


func _zombies() -> Zombies:
	var game := Zombies.new()
	_begin(game)
	return game


func _begin(game: LudusSimulation) -> void:
	var root := Node2D.new()
	root.set_meta(Original.METADATA, Original.ORIGINAL)
	add(root)
	game.world = LudusWorld.new()
	root.add_child(game.world)
	game.world.set_seed(5)
	game.world.begin_episode()
	game.create()
	game.begin_episode()


func _step_coin(game: FindCoin, hero: Vector2, target: Vector2) -> void:
	game.apply_action(0, PackedFloat32Array([hero.x, hero.y]))
	game.apply_action(1, PackedFloat32Array([target.x, target.y]))
	game.advance()


func _step_all(
	game: Zombies, soldier: Array[float], zombie: Array[float] = [0.0, 0.0, 0.0]
) -> void:
	game.apply_action(0, PackedFloat32Array(soldier))
	game.apply_action(1, PackedFloat32Array(zombie))
	game.apply_action(2, PackedFloat32Array([0.0, 0.0, 0.0]))
	game.advance()


func _zeros(count: int) -> PackedFloat32Array:
	var zeros := PackedFloat32Array()
	zeros.resize(count)
	return zeros


func near(value: float, expected: float, what: String, tolerance: float = 1e-4) -> void:
	check(absf(value - expected) < tolerance, "%s: %f, expected %f" % [what, value, expected])
