extends "ludus_test.gd"
## Where copies of a scene are put.


func test_a_grid_in_three_dimensions() -> void:
	for num_worlds in [1, 2, 4, 9, 10, 27]:
		var places := _places(Spatial.new(), Vector3(10, 20, 30), num_worlds)
		equal(places.size(), num_worlds, "worlds")
		_check_apart(places, Vector3(10, 20, 30), int(ceil(pow(num_worlds, 1.0 / 3.0) - 1e-9)))


func test_an_axis_without_spacing_is_not_used() -> void:
	var places := _places(Spatial.new(), Vector3(10, 0, 30), 16)
	_check_apart(places, Vector3(10, 0, 30), 4)


func test_a_grid_in_two_dimensions() -> void:
	var places := _places(Node2D.new(), Vector3(100, 50, 0), 9)
	_check_apart(places, Vector3(100, 50, 0), 3)


func test_copies_share_a_space_in_the_grid_only() -> void:
	for layout_name in ["grid", "isolated"]:
		var stage := _stage(Spatial.new(), Vector3(10, 0, 10), 3, layout_name)
		check(stage.build(), stage.error)
		var spaces := {}
		for world in stage.worlds:
			spaces[world.root.get_viewport().find_world().space.get_id()] = true
			if layout_name == "isolated":
				equal(world.root.translation, Vector3.ZERO, "an isolated copy")
		equal(spaces.size(), 1 if layout_name == "grid" else 3, layout_name)


func test_copies_in_two_dimensions_have_no_3d_space() -> void:
	var stage := _stage(Node2D.new(), Vector3(10, 0, 10), 3, "isolated")
	check(stage.build(), stage.error)
	var spaces := {}
	for world in stage.worlds:
		var viewport: Viewport = world.root.get_viewport()
		spaces[viewport.world_2d.space.get_id()] = true
		check(not viewport.own_world, "no 3D world")
	equal(spaces.size(), 3, "2D spaces")


func test_bullet_keeps_no_more_spaces() -> void:
	var stage := _stage(Spatial.new(), Vector3(10, 0, 10), 127, "isolated")
	_check_refused(stage, "Bullet can keep 126")


func test_worlds_are_numbered_among_all_engines() -> void:
	var stage := _stage(Spatial.new(), Vector3(10, 0, 10), 3, "isolated", 6)
	check(stage.build(), stage.error)
	for i in 3:
		equal(stage.worlds[i].index, 6 + i, "index")


func test_building_anew_keeps_parameters() -> void:
	var stage := _stage(Spatial.new(), Vector3(10, 0, 10), 2)
	check(stage.build(), stage.error)
	var old: LudusWorld = stage.worlds[1]
	old.parameters = {"wind": 2.5}
	check(stage.build(), stage.error)
	equal(stage.worlds.size(), 2, "worlds")
	check(not is_instance_valid(old), "the old world is gone")
	equal(stage.worlds[1].parameters, {"wind": 2.5}, "parameters")


func test_a_world_made_anew_keeps_its_place() -> void:
	for layout_name in ["grid", "isolated"]:
		var stage := _stage(Spatial.new(), Vector3(10, 0, 10), 3, layout_name)
		check(stage.build(), stage.error)
		stage.worlds[1].set_seed(7)
		stage.worlds[1].begin_episode()
		var place: Vector3 = stage.worlds[1].root.translation
		var viewport: Viewport = stage.worlds[1].root.get_viewport()
		var world := stage.rebuild_world(1)
		equal(world.root.translation, place, "place")
		check(world.root.get_viewport() == viewport, "viewport")
		check(stage.worlds[1] == world and stage.worlds.size() == 3, "the list")
		equal(world.index, 1, "index")
		equal(world.num_episodes, 1, "episodes")


func test_copies_without_spacing_are_further_apart_than_a_window_or_a_room() -> void:
	var flat := _places(Node2D.new(), Vector3.ZERO, 4)
	var width: int = ProjectSettings.get_setting("display/window/size/width")
	var height: int = ProjectSettings.get_setting("display/window/size/height")
	_check_apart(flat, 2.0 * Vector3(width, height, 0.0), 2)
	_check_apart(_places(Spatial.new(), Vector3.ZERO, 4), LudusWorld.DISTANCE_3D, 2)


func test_scenes_that_do_not_fit_the_grid() -> void:
	_check_refused(_stage(Control.new(), Vector3.ONE, 2), "not Control")
	_check_refused(_stage(Node2D.new(), Vector3(0, 0, 9), 2), "spacing")
	_check_refused(_stage(Spatial.new(), Vector3.ONE, 2, "grid", 0, 5), "settle_ticks")


func _check_refused(stage: LudusStage, why: String) -> void:
	check(not stage.build(), "built in spite of: " + why)
	check(why in stage.error, "%s: %s" % [why, stage.error])


## Every copy lies on a multiple of the spacing, alone, in a block around the origin.
func _check_apart(places: Array, spacing: Vector3, side: int) -> void:
	var seen := {}
	for place in places:
		for axis in 3:
			if spacing[axis] == 0.0:
				equal(place[axis], 0.0, "an unused axis")
				continue
			var cell: float = place[axis] / spacing[axis]
			equal(cell, round(cell), "a multiple of the spacing")
			check(abs(cell) <= ceil(side / 2.0), "%s is far away" % place)
		seen[place] = true
	equal(seen.size(), places.size(), "different places")


func _places(root: Node, spacing: Vector3, num_worlds: int) -> Array:
	var stage := _stage(root, spacing, num_worlds)
	check(stage.build(), stage.error)
	var places := []
	for world in stage.worlds:
		if world.root is Node2D:
			places.append(Vector3(world.root.position.x, world.root.position.y, 0.0))
		else:
			places.append(world.root.translation)
	return places


func _stage(
	root: Node,
	spacing: Vector3,
	num_worlds: int,
	layout_name: String = "grid",
	first_world: int = 0,
	settle_ticks: int = 0
) -> LudusStage:
	var world := LudusWorld.new()
	world.spacing = spacing
	world.settle_ticks = settle_ticks
	root.add_child(world)
	world.owner = root
	var scene := PackedScene.new()
	check(scene.pack(root) == OK, "a scene")
	root.free()
	var stage := LudusStage.new()
	add(stage)
	stage.configure(scene, num_worlds, first_world, layout_name)
	return stage
