extends "ludus_test.gd"
## The rules of the example "tag": its rounds, how bodies move, and play by hand.

const LudusManualPlay := preload("res://addons/ludus/bridge/manual_play.gd")

const Arena := preload("res://examples/tag/arena.gd")
const Body := preload("res://examples/tag/body.gd")
const Chaser := preload("res://examples/tag/chaser.gd")
const Round := preload("res://examples/tag/round.gd")
const Runner := preload("res://examples/tag/runner.gd")
const SCENE := preload("res://examples/tag/tag.tscn")

const TICK_S := 1.0 / 60.0
const NUM_ROUNDS := 200


func test_every_round_leaves_room() -> void:
	var game := Round.new()
	var rng := RandomNumberGenerator.new()
	rng.seed = 5
	var narrowest := INF
	var nearest := INF
	for i: int in NUM_ROUNDS:
		game.begin(rng, 600)
		narrowest = minf(narrowest, _narrowest_passage(game))
		nearest = minf(nearest, game.starts[0].distance_to(game.starts[1]))
		for start: Vector2 in game.starts:
			check(game.is_free(start, Round.CLEARANCE), "round %d starts at %s" % [i, start])
	var chaser_diameter := 2.0 * (_arena().get_node("Chaser") as Body).radius
	check(narrowest > chaser_diameter, "narrowest passage: %f" % narrowest)
	check(nearest >= Round.START_GAP, "nearest start: %f" % nearest)


func test_a_catch_and_a_time_limit_decide() -> void:
	var game := _round(3)
	var far := Vector2(Round.CATCH_GAP + 1.0, 0.0)
	var begun := game.starts[0].distance_to(game.starts[1])
	var total := game.advance(Vector2.ZERO, far)
	total += game.advance(Vector2.ZERO, far)
	check(not game.is_over, "two of three ticks")
	total += game.advance(Vector2.ZERO, far)
	check(game.is_over and not game.is_caught, "the time is up")
	var nearer := (begun - far.length()) * Round.NEARER_REWARD
	check(is_equal_approx(total, nearer - Round.WIN_REWARD), "chaser's return: %f" % total)
	game = _round(3)
	total = game.advance(Vector2.ZERO, Vector2(Round.CATCH_GAP - 1.0, 0.0))
	check(game.is_over and game.is_caught, "caught")
	check(total > 0.9 and total < 1.3, "chaser's return: %f" % total)


func test_shaping_never_changes_who_wins() -> void:
	var diagonal := 2.0 * Round.HALF_SIDE * sqrt(2.0)
	check(diagonal * Round.NEARER_REWARD < 0.5 * Round.WIN_REWARD, "shaping is light")


func test_chaser_is_faster_and_runner_turns_faster() -> void:
	var arena := _arena()
	var times: Array[int] = []
	for path: String in ["Chaser", "Runner"]:
		var body := arena.get_node(path) as Body
		body.reset()
		arena.game.pillars.fill(Vector2(0.0, 10000.0))
		body.position = Vector2(-250.0, 0.0)
		_run(body, Vector2.RIGHT)
		for i: int in 60:
			body.move(TICK_S)
		equal(body.velocity.length(), body.max_speed, path + " at full speed")
		_run(body, Vector2.LEFT)
		var ticks := 0
		while body.velocity.x > 0.0:
			body.move(TICK_S)
			ticks += 1
		times.append(ticks)
	check(times[0] > 3 * times[1], "ticks to turn: %s" % [times])
	var speeds: Array[float] = []
	for path: String in ["Chaser", "Runner"]:
		speeds.append((arena.get_node(path) as Body).max_speed)
	check(speeds[0] > speeds[1], "speeds: %s" % [speeds])


func test_walls_and_pillars_hold() -> void:
	var arena := _arena()
	var rng := RandomNumberGenerator.new()
	rng.seed = 6
	for path: String in ["Chaser", "Runner"]:
		var body := arena.get_node(path) as Body
		body.reset()
		for i: int in 3000:
			if i % 20 == 0:
				_run(body, Vector2.from_angle(rng.randf() * TAU))
			body.move(TICK_S)
			if not arena.game.is_free(body.position, body.radius - 0.01):
				check(false, "%s at %s" % [path, body.position])
				return
	check(true, "")


func test_directions_of_the_chaser() -> void:
	equal(Chaser.direction(0), Vector2.ZERO, "stand")
	for action: int in Chaser.NUM_DIRECTIONS + 1:
		equal(Chaser.nearest_action(Chaser.direction(action) * 3.0), action, "action")
	check(Chaser.direction(3).is_equal_approx(Vector2.DOWN), "clockwise from +x")


func test_by_hand_both_begin_each_round_together() -> void:
	var arena := _arena()
	var play := LudusManualPlay.new()
	var chaser := arena.get_node("Chaser") as Body
	var runner := arena.get_node("Runner") as Body
	var chaser_agent := chaser.get_node("LudusAgent") as LudusAgent
	var runner_agent := runner.get_node("LudusAgent") as LudusAgent
	for i: int in 3000:
		play.advance()
		if chaser_agent.episode_steps != runner_agent.episode_steps:
			check(false, "tick %d: one has begun without the other" % i)
			return
		if arena.game.ticks_left == arena.game.num_ticks:
			equal(chaser.position, arena.game.starts[0], "chaser's start")
			equal(runner.position, arena.game.starts[1], "runner's start")
		arena._physics_process(TICK_S)
	check(arena.game.number > 3, "rounds: %d" % arena.game.number)


func test_keys_steer_for_one_round() -> void:
	var arena := _arena()
	var chaser := arena.get_node("Chaser") as Chaser
	var runner := arena.get_node("Runner") as Runner
	for body: Body in [chaser, runner]:
		body.reset()
	press(KEY_S, true)
	equal(chaser.get_manual_action(), 3, "S pushes down")
	press(KEY_S, false)
	equal(chaser.get_manual_action(), 0, "let go")
	press(KEY_LEFT, true)
	equal(runner.get_manual_action(), PackedFloat32Array([-1.0, 0.0]), "left")
	press(KEY_LEFT, false)
	equal(runner.get_manual_action(), PackedFloat32Array([0.0, 0.0]), "let go")
	for body: Body in [chaser, runner]:
		body.reset()
	check(chaser.get_manual_action() > 0, "hunts by itself")
	check(runner.get_manual_action() != PackedFloat32Array([0.0, 0.0]), "flees by itself")


func _arena() -> Arena:
	var arena := SCENE.instantiate() as Arena
	add(arena)
	return arena


func _round(ticks: int) -> Round:
	var game := Round.new()
	game.begin(RandomNumberGenerator.new(), ticks)
	return game


func _run(body: Body, wish: Vector2) -> void:
	if body is Chaser:
		(body as Chaser).apply_action(Chaser.nearest_action(wish))
	else:
		(body as Runner).apply_action(PackedFloat32Array([wish.x, wish.y]))


func _narrowest_passage(game: Round) -> float:
	var narrowest := INF
	for i: int in Round.NUM_PILLARS:
		var centre := game.pillars[i]
		var from_wall := Round.HALF_SIDE - maxf(absf(centre.x), absf(centre.y))
		narrowest = minf(narrowest, from_wall - game.radii[i])
		for k: int in i:
			var between := centre.distance_to(game.pillars[k])
			narrowest = minf(narrowest, between - game.radii[i] - game.radii[k])
	return narrowest
