extends "ludus_test.gd"
## The rules of the example "key_door": moves, mask, key, doors, and play by hand.

const LudusManualPlay := preload("res://addons/ludus/bridge/manual_play.gd")

const KeyDoor := preload("res://examples/key_door/key_door.gd")
const Plan := preload("res://examples/key_door/plan.gd")
const SCENE := preload("res://examples/key_door/key_door.tscn")

const CROSSING := Vector2i(6, 1)


func test_the_plan_has_a_room_a_corridor_and_three_doors() -> void:
	var doors: Array[int] = []
	for cell: Vector2i in Plan.cells():
		if Plan.door_at(cell) >= 0:
			doors.append(Plan.door_at(cell))
			check(not Plan.is_floor(cell + Plan.DOOR_SIDES[Plan.door_at(cell)]), "a door in a wall")
	doors.sort()
	equal(doors, [0, 1, 2] as Array[int], "doors")
	for x: int in range(Plan.ROOM_SIZE.x, CROSSING.x):
		equal(Plan.moves_from(Vector2i(x, 1)), PackedByteArray([1, 1, 0, 0]), "corridor")
	equal(Plan.moves_from(CROSSING), PackedByteArray([1, 1, 1, 1]), "crossing")


func test_the_colour_is_gone_before_the_crossing() -> void:
	check(CROSSING.x - (Plan.ROOM_SIZE.x - 1) > KeyDoor.NUM_COLOURED, "the corridor is long enough")


func test_the_mask_forbids_walls_and_doors_without_key() -> void:
	var game := _game({"door": 1})
	game.hero = Vector2i.ZERO
	equal(game.get_action_mask(), PackedByteArray([0, 1, 0, 1, 0]), "in the corner")
	game.hero = Vector2i(7, 1)
	equal(game.get_action_mask(), PackedByteArray([1, 0, 0, 0, 0]), "at a door without key")
	game.has_key = true
	equal(game.get_action_mask(), PackedByteArray([1, 0, 0, 0, 1]), "at a door with key")
	game.hero = CROSSING
	equal(game.get_action_mask(), PackedByteArray([1, 1, 1, 1, 0]), "away from doors")


func test_what_the_mask_forbids_does_nothing() -> void:
	var game := _game({"door": 1})
	game.key = Vector2i(1, 0)
	game.hero = Vector2i.ZERO
	for action: int in [KeyDoor.Action.LEFT, KeyDoor.Action.UP, KeyDoor.Action.OPEN]:
		game.apply_action(action)
		equal(game.hero, Vector2i.ZERO, "place")
		check(not game.is_done() and game.get_reward() == 0.0, "nothing happens")
	game.hero = Vector2i(7, 1)
	game.apply_action(KeyDoor.Action.OPEN)
	check(not game.is_done(), "no key, no door")


func test_the_key_is_worth_something_once() -> void:
	var game := _game({})
	game.hero = Vector2i(1, 1)
	game.key = Vector2i(0, 1)
	game.apply_action(KeyDoor.Action.LEFT)
	check(game.has_key and game.get_reward() == KeyDoor.KEY_REWARD, "picked up")
	game.apply_action(KeyDoor.Action.RIGHT)
	equal(game.get_reward(), 0.0, "on the way")
	game.apply_action(KeyDoor.Action.LEFT)
	equal(game.get_reward(), 0.0, "a second time")


func test_only_the_right_door_is_worth_something() -> void:
	for door: int in Plan.NUM_DOORS:
		var game := _game({"door": door})
		game.has_key = true
		game.hero = Vector2i(7, 1)
		game.apply_action(KeyDoor.Action.OPEN)
		check(game.is_done(), "a door ends the episode")
		equal(game.get_reward(), KeyDoor.DOOR_REWARD if door == 1 else 0.0, "door %d" % door)


func test_the_colour_shows_in_three_observations() -> void:
	var game := _game({"door": 2})
	game.hero = Vector2i.ZERO
	game.key = Vector2i(2, 2)
	for i: int in 6:
		var colour := game.get_observation().slice(5)
		var expected := [0, 0, 1] if i < KeyDoor.NUM_COLOURED else [0, 0, 0]
		equal(colour, PackedFloat32Array(expected), "observation %d" % i)
		game.apply_action(KeyDoor.Action.RIGHT if i % 2 == 0 else KeyDoor.Action.LEFT)


func test_every_episode_begins_in_the_room_and_all_doors_come_up() -> void:
	var game := _game({})
	var doors := {}
	for i: int in 200:
		LudusWorld.of(game).begin_episode()
		game.reset()
		doors[game.door] = true
		check(game.hero != game.key, "hero on the key")
		for cell: Vector2i in [game.hero, game.key]:
			check(Rect2i(Vector2i.ZERO, Plan.ROOM_SIZE).has_point(cell), "starts at %s" % cell)
	equal(doors.size(), Plan.NUM_DOORS, "doors seen")


func test_by_hand_time_stands_still_until_a_key_is_pressed() -> void:
	var game := _game({})
	var agent := game.get_node("LudusAgent") as LudusAgent
	var play := LudusManualPlay.new()
	for i: int in 100 * agent.ticks_per_step:
		play.advance()
	equal([game.num_moves, agent.episode_steps], [0, 0], "nothing pressed")
	game.hero = Vector2i(1, 1)
	_press(game, KEY_LEFT)
	_advance_step(play, agent)
	equal(game.hero, Vector2i(0, 1), "left")
	_press(game, KEY_A)
	_advance_step(play, agent)
	equal([game.hero, game.num_moves], [Vector2i(0, 1), 1], "into the wall")
	_press(game, KEY_W)
	_advance_step(play, agent)
	equal([game.hero, game.num_moves, agent.episode_steps], [Vector2i(0, 0), 2, 2], "up")


func test_by_hand_a_door_begins_a_new_episode() -> void:
	var game := _game({})
	var agent := game.get_node("LudusAgent") as LudusAgent
	var play := LudusManualPlay.new()
	_advance_step(play, agent)
	game.has_key = true
	game.hero = Vector2i(7, 1)
	_press(game, KEY_SPACE)
	_advance_step(play, agent)
	check(game.is_done(), "opened")
	_advance_step(play, agent)
	check(not game.is_done() and not game.has_key and game.num_moves == 0, "a new episode")


func _game(parameters: Dictionary) -> KeyDoor:
	var game := SCENE.instantiate() as KeyDoor
	add(game)
	LudusWorld.of(game).parameters = parameters
	game.reset()
	return game


func _press(game: KeyDoor, key: Key) -> void:
	var event := InputEventKey.new()
	event.physical_keycode = key
	event.pressed = true
	game._unhandled_key_input(event)


func _advance_step(play: LudusManualPlay, agent: LudusAgent) -> void:
	for i: int in agent.ticks_per_step:
		play.advance()
