extends "ludus_test.gd"
## Cameras of agents, in an engine that cannot draw.


func test_without_a_renderer_pictures_are_black() -> void:
	for camera in [LudusCamera3D.new(), LudusCamera2D.new()]:
		camera.width = 5
		camera.height = 3
		add(camera)
		var image: Image = camera.get_image()
		equal(image.get_size(), Vector2(5, 3), "size")
		var black := PoolByteArray()
		black.resize(5 * 3 * 3)
		black.fill(0)
		equal(camera.get_pixels(), black, "red, green, blue")
		camera.channels = camera.Channels.GREY
		equal(camera.get_pixels().size(), 5 * 3, "grey")


func test_pictures_become_entries_of_bytes() -> void:
	var camera := LudusCamera2D.new()
	camera.width = 7
	camera.height = 4
	add(camera)
	var entry: LudusObservationEntry = LudusObservationEntry.infer("eye", camera.get_image())
	equal(entry.dtype, LudusObservationEntry.DType.UINT8, "type")
	equal(Array(entry.shape), [4, 7, 3], "shape")
	equal(entry.to_bytes(camera.get_image()).size(), 4 * 7 * 3, "bytes")


func test_who_needs_a_renderer_is_named() -> void:
	equal(LudusCameras.find_problem(), "", "no camera")
	var root := Spatial.new()
	var head := Spatial.new()
	head.name = "Head"
	var camera := LudusCamera3D.new()
	camera.name = "Eye"
	head.add_child(camera)
	root.add_child(head)
	var world := LudusWorld.new()
	root.add_child(world)
	world.attach(root)
	add(root)
	check(
		"camera Head/Eye needs a renderer" in LudusCameras.find_problem(), "its path in the world"
	)
	check(not LudusCameras.take_beginnings(), "nothing to wait for")
	root.free()
	equal(LudusCameras.find_problem(), "", "the camera is gone")
	check(not LudusCameras.are_used(), "no camera is left")


func test_a_picture_lasts_until_an_episode_begins() -> void:
	var root := Node2D.new()
	var camera := LudusCamera2D.new()
	root.add_child(camera)
	var world := LudusWorld.new()
	root.add_child(world)
	world.attach(root)
	var view := LudusCameraView.new(camera)
	check(not view.take_beginning(), "none yet")
	for _i in 2:
		world.set_seed(1)
		world.begin_episode()
		check(view.take_beginning(), "an episode with an old number")
		check(not view.take_beginning(), "taken")
	check(view.is_stale(), "never drawn")
	root.free()
