extends "ludus_test.gd"
## Random streams, and whose world a node lives in.

const NUM_DRAWS := 4


func test_equal_seeds_and_episodes_give_equal_numbers() -> void:
	var first := _world(7)
	var second := _world(7)
	for episode in 3:
		equal(_draw(second), _draw(first), "episode %d" % episode)


func test_the_stream_depends_on_seed_and_episode_only() -> void:
	var expected := []
	var quiet := _world(7)
	for _episode in 3:
		expected = _draw(quiet)
	var busy := _world(99)
	busy.begin_episode()
	busy.set_seed(7)
	for _episode in 2:
		busy.begin_episode()
		for _i in 50:
			busy.rng.randf()
	equal(_draw(busy), expected, "the third episode of seed 7")


func test_neighbours_differ() -> void:
	var seen := {}
	for seed_value in 64:
		var world := _world(seed_value)
		for _episode in 64:
			seen[str(_draw(world))] = true
	equal(seen.size(), 64 * 64, "different streams")


func test_large_seeds_differ() -> void:
	var seen := {}
	for seed_value in [0, -1, 1 << 63, (1 << 63) + 1, (1 << 63) - 1, 1 << 32, 1]:
		seen[str(_draw(_world(seed_value)))] = true
	equal(seen.size(), 7, "different streams")


func test_neighbouring_worlds_are_not_correlated() -> void:
	var sum := 0.0
	for seed_value in 2000:
		var world := _world(seed_value)
		world.begin_episode()
		sum += world.rng.randf()
	check(abs(sum / 2000.0 - 0.5) < 0.03, "first numbers have mean %f" % (sum / 2000.0))


func test_a_replacement_goes_on() -> void:
	var old := _world(7)
	old.parameters = {"wind": 2.5}
	var _first := _draw(old)
	var replacement := _world(0)
	replacement.take_over(old)
	equal(_draw(replacement), _draw(old), "the second episode")
	equal(replacement.parameters, {"wind": 2.5}, "parameters")


func test_the_world_of_a_node() -> void:
	var root := Spatial.new()
	var child := Node.new()
	root.add_child(child)
	child.owner = root
	add(root)
	check(LudusWorld.find_above(child) == null, "no world yet")
	var world := LudusWorld.of(child)
	check(world != null and world.root == root, "a world for the scene")
	check(LudusWorld.of(root) == world, "the same for all its nodes")


func test_the_world_of_a_root() -> void:
	var root := Node.new()
	add(root)
	var world := LudusWorld.of(root)
	check(world.root == root, "its root")
	check(LudusWorld.find_in(root) == world, "found in the scene")


func test_the_world_of_a_scene_in_a_scene() -> void:
	var level := Node2D.new()
	var player := _instance_in(level)
	var world := LudusWorld.new()
	world.episode_mode = LudusWorld.Episode.WORLD
	level.add_child(world)
	add(level)
	check(LudusWorld.of(player.get_child(0)) == world, "the world of the level")
	check(world.root == level, "its root")
	var spawned := _instance_in(null)
	level.add_child(spawned)
	check(LudusWorld.of(spawned.get_child(0)) == world, "of one that came later")


func test_the_default_world_is_that_of_the_outermost_scene() -> void:
	var level := Node2D.new()
	var first := _instance_in(level)
	var second := _instance_in(level)
	add(level)
	var world := LudusWorld.of(first.get_child(0))
	check(world.root == level, "its root")
	check(LudusWorld.of(second.get_child(0)) == world, "both players share it")


func test_the_world_of_nodes_made_in_code() -> void:
	var main := Node.new()
	add(main)
	tree.current_scene = main
	var spawned := _instance_in(null)
	main.add_child(spawned)
	check(LudusWorld.of(spawned.get_child(0)).root == main, "the current scene")
	tree.current_scene = null


func test_the_world_of_a_lone_scene_outside_the_current_one() -> void:
	var spawned := _instance_in(null)
	add(spawned)
	check(LudusWorld.of(spawned.get_child(0)).root == spawned, "the scene itself")


func test_a_change_is_told_once() -> void:
	var _before := LudusWorld.take_change(LudusWorld.NEWCOMERS)
	LudusWorld.announce(LudusWorld.NEWCOMERS)
	check(LudusWorld.take_change(LudusWorld.NEWCOMERS), "after it was announced")
	check(not LudusWorld.take_change(LudusWorld.NEWCOMERS), "after it was taken")


func test_warnings() -> void:
	var root := Node2D.new()
	var world := LudusWorld.new()
	root.add_child(world)
	world.owner = root
	add(root)
	equal(world._get_configuration_warning(), "", "nothing is wrong")
	world.layout = LudusWorld.Layout.GRID
	world.settle_ticks = 3
	check("settle_ticks" in world._get_configuration_warning(), "settle_ticks")
	world.settle_ticks = 0
	equal(world._get_configuration_warning(), "", "no spacing is chosen")


func test_warnings_about_the_root() -> void:
	var root := Control.new()
	var middle := Node.new()
	var world := LudusWorld.new()
	root.add_child(middle)
	middle.add_child(world)
	world.owner = root
	add(root)
	check("directly under the root" in world._get_configuration_warning(), "the place")
	world.layout = LudusWorld.Layout.GRID
	check("Node2D or a Spatial" in world._get_configuration_warning(), "the root")


## The root of a scene with one node, as it stands in the scene of [param outer].
func _instance_in(outer: Node) -> Node:
	var inner := Node2D.new()
	var child := Node.new()
	inner.add_child(child)
	child.owner = inner
	if outer != null:
		outer.add_child(inner)
		inner.owner = outer
	return inner


func _world(seed_value: int) -> LudusWorld:
	var world := LudusWorld.new()
	add(world)
	world.set_seed(seed_value)
	return world


func _draw(world: LudusWorld) -> Array:
	world.begin_episode()
	var numbers := []
	for _i in NUM_DRAWS:
		numbers.append(world.rng.randi())
	return numbers
