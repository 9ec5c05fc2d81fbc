extends "ludus_test.gd"
## Where copies of a scene are put.

const LudusStage := preload("res://addons/ludus/world/stage.gd")


func test_a_grid_in_three_dimensions() -> void:
	for num_worlds: int in [1, 2, 4, 9, 10, 27]:
		var places := _places(Node3D.new(), Vector3(10, 20, 30), num_worlds)
		equal(places.size(), num_worlds, "worlds")
		_check_apart(places, Vector3(10, 20, 30), ceili(pow(num_worlds, 1.0 / 3.0) - 1e-9))


func test_an_axis_without_spacing_is_not_used() -> void:
	var places := _places(Node3D.new(), Vector3(10, 0, 30), 16)
	_check_apart(places, Vector3(10, 0, 30), 4)


func test_a_grid_in_two_dimensions() -> void:
	var places := _places(Node2D.new(), Vector3(100, 50, 0), 9)
	_check_apart(places, Vector3(100, 50, 0), 3)


func test_a_grid_on_a_line() -> void:
	var places := _places(Node2D.new(), Vector3(100, 0, 100), 5)
	_check_apart(places, Vector3(100, 0, 0), 5)


func test_one_world_stays_where_it_is() -> void:
	var stage := _stage(Node3D.new(), Vector3(10, 10, 10), 1)
	check(stage.build(), stage.error)
	equal((stage.worlds[0].root as Node3D).position, Vector3.ZERO, "the only world")


func test_copies_share_a_space_in_the_grid_only() -> void:
	for layout_name: String in ["grid", "isolated"]:
		var stage := _stage(Node3D.new(), Vector3(10, 0, 10), 3, layout_name)
		check(stage.build(), stage.error)
		var spaces := {}
		for world: LudusWorld in stage.worlds:
			spaces[world.root.get_viewport().find_world_3d().space] = true
		equal(spaces.size(), 1 if layout_name == "grid" else 3, layout_name)


func test_isolated_copies_stay_where_they_are() -> void:
	var stage := _stage(Node3D.new(), Vector3(10, 0, 10), 3, "isolated")
	check(stage.build(), stage.error)
	for world: LudusWorld in stage.worlds:
		equal((world.root as Node3D).position, Vector3.ZERO, "an isolated copy")


func test_worlds_are_numbered_among_all_engines() -> void:
	var stage := _stage(Node3D.new(), Vector3(10, 0, 10), 3, "isolated", 6)
	stage.build()
	equal(stage.worlds.map(func(w: LudusWorld) -> int: return w.index), [6, 7, 8], "index")


func test_building_anew_keeps_parameters() -> void:
	var stage := _stage(Node3D.new(), Vector3(10, 0, 10), 2)
	stage.build()
	var old := stage.worlds[1]
	old.parameters = {"wind": 2.5}
	stage.build()
	equal(stage.worlds.size(), 2, "worlds")
	check(not is_instance_valid(old), "the old world is gone")
	equal(stage.worlds[1].parameters, {"wind": 2.5}, "parameters")


func test_a_world_made_anew_keeps_its_place() -> void:
	for layout_name: String in ["grid", "isolated"]:
		var stage := _stage(Node3D.new(), Vector3(10, 0, 10), 3, layout_name)
		stage.build()
		stage.worlds[1].set_seed(7)
		stage.worlds[1].begin_episode()
		var place := (stage.worlds[1].root as Node3D).position
		var viewport := stage.worlds[1].root.get_viewport()
		var others := [stage.worlds[0], stage.worlds[2]]
		var world := stage.rebuild_world(1)
		equal((world.root as Node3D).position, place, "place")
		check(world.root.get_viewport() == viewport, "viewport")
		equal([stage.worlds[0], stage.worlds[2]], others, "the other worlds")
		check(stage.worlds[1] == world and stage.worlds.size() == 3, "the list")
		equal(world.index, 1, "index")
		equal(world.num_episodes, 1, "episodes")


func test_copies_without_spacing_are_further_apart_than_a_window_or_a_room() -> void:
	var flat := _places(Node2D.new(), Vector3.ZERO, 4)
	var width: int = ProjectSettings.get_setting("display/window/size/viewport_width")
	var height: int = ProjectSettings.get_setting("display/window/size/viewport_height")
	_check_apart(flat, 2.0 * Vector3(width, height, 0.0), 2)
	_check_apart(_places(Node3D.new(), Vector3.ZERO, 4), LudusWorld.DISTANCE_3D, 2)


func test_scenes_that_do_not_fit_the_grid() -> void:
	_check_refused(_stage(Control.new(), Vector3.ONE, 2), "not Control")
	_check_refused(_stage(Node2D.new(), Vector3(0, 0, 9), 2), "spacing")
	var settling := _stage(Node3D.new(), Vector3.ONE, 2, "grid", 0, 5)
	_check_refused(settling, "settle_ticks")


func _check_refused(stage: LudusStage, why: String) -> void:
	check(not stage.build(), "built in spite of: " + why)
	check(why in stage.error, "%s: %s" % [why, stage.error])


## Every copy lies on a multiple of the spacing, alone, in a block around the origin.
func _check_apart(places: Array[Vector3], spacing: Vector3, side: int) -> void:
	var seen := {}
	for place: Vector3 in places:
		for axis: int in 3:
			if spacing[axis] == 0.0:
				equal(place[axis], 0.0, "an unused axis")
				continue
			var cell := place[axis] / spacing[axis]
			equal(cell, roundf(cell), "a multiple of the spacing")
			check(absf(cell) <= ceilf(side / 2.0), "%s is far away" % place)
		seen[place] = true
	equal(seen.size(), places.size(), "different places")


func _places(root: Node, spacing: Vector3, num_worlds: int) -> Array[Vector3]:
	var stage := _stage(root, spacing, num_worlds)
	check(stage.build(), stage.error)
	var places: Array[Vector3] = []
	for world: LudusWorld in stage.worlds:
		if world.root is Node2D:
			var flat := (world.root as Node2D).position
			places.append(Vector3(flat.x, flat.y, 0.0))
		else:
			places.append((world.root as Node3D).position)
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
	scene.pack(root)
	root.free()
	var stage := LudusStage.new()
	add(stage)
	stage.configure(scene, num_worlds, first_world, layout_name)
	return stage
