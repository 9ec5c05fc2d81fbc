extends "ludus_test.gd"
## What sensors say, by arithmetic, and how they become entries. Rays are tested in a game.

const GAME := """
extends CharacterBody2D
func apply_action(_action: int) -> void: pass
func get_reward() -> float: return 0.0
func is_done() -> bool: return false
func reset() -> void: pass
"""
const OBSERVES := "func get_observation() -> Array: return [7.0, 8.0]\n"


func test_sensors_are_the_observation() -> void:
	var agent := _agent(GAME)
	var nearest := LudusNearest2D.new()
	nearest.name = "Coins"
	nearest.group = &"coins"
	nearest.count = 2
	nearest.reach = 100.0
	agent.get_parent().add_child(nearest)
	var grid := LudusGrid2D.new()
	grid.name = "Map"
	grid.groups = [&"coins"]
	grid.cells = Vector2i(3, 3)
	grid.cell_size = Vector2(20.0, 20.0)
	agent.get_parent().add_child(grid)
	for place: Vector2 in [Vector2(130, 100), Vector2(100, 120), Vector2(400, 100)]:
		var coin := Node2D.new()
		coin.add_to_group(&"coins")
		coin.position = place
		agent.get_parent().get_parent().add_child(coin)
	equal(agent.connect_to_game(), "", "connect_to_game")
	equal(agent._get_configuration_warnings().size(), 0, "warnings")
	var seen: Dictionary = agent.observer.get_observation()
	equal(seen.keys(), ["Coins", "Map"], "entries")
	var expected := PackedFloat32Array([0.0, 0.2, 0.3, 0.0, 1.0])
	equal(seen["Coins"], expected, "the nearest first, then the share of the count")
	var cells: PackedFloat32Array = seen["Map"]
	equal(Array(cells), [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0], "cells")
	var entries := agent.known_entries()
	equal(entries.map(func(e: LudusObservationEntry) -> int: return e.size()), [5, 9], "sizes")
	equal([entries[0].low, entries[1].low, entries[1].high], [-1.0, 0.0, 1.0], "bounds")


func test_the_grid_of_copies_does_not_show() -> void:
	var seen: Array[Variant] = []
	for offset: Vector2 in [Vector2.ZERO, Vector2(12345.6, -789.1)]:
		var agent := _agent(GAME)
		var body := agent.get_parent() as Node2D
		var root := body.get_parent() as Node2D
		root.position = offset
		body.rotation = 1.0
		var other := Node2D.new()
		other.position = Vector2(31.7, 17.3)
		root.add_child(other)
		var relative := LudusRelative2D.new()
		relative.nodes = [other]
		relative.parts = 15
		body.add_child(relative)
		equal(agent.connect_to_game(), "", "connect_to_game")
		seen.append(agent.observer.get_observation())
	equal(seen[0], seen[1], "equal to the bit")
	equal((seen[0] as PackedFloat32Array).size(), 8, "numbers")
	check((seen[0] as PackedFloat32Array)[0] != 0.0, "it sees")


func test_the_frame_is_the_sensors_own() -> void:
	var root := Node3D.new()
	add(root)
	LudusWorld.of(root)
	var sensor := LudusRelative3D.new()
	sensor.rotation.y = PI / 2.0
	sensor.reach = 10.0
	sensor.parts = LudusRelative3D.Part.POSITION + LudusRelative3D.Part.ROTATION
	var other := Node3D.new()
	other.position = Vector3(0.0, 0.0, 5.0)
	sensor.nodes = [other]
	root.add_child(other)
	root.add_child(sensor)
	var seen := sensor.sense()
	for i: int in 6:
		near(seen[i], [-0.5, 0.0, 0.0, 1.0, 0.0, 0.0][i], 1e-6, "number %d" % i)
	other.free()
	equal(Array(sensor.sense()), [0.0, 0.0, 0.0, 0.0, 0.0, 0.0], "a node that is gone")


func test_members_that_leave_in_a_tick_are_left_out() -> void:
	var agent := _agent(GAME)
	var nearest := LudusNearest2D.new()
	nearest.group = &"coins"
	nearest.count = 3
	agent.get_parent().add_child(nearest)
	var coins: Array[Node2D] = []
	for i: int in 3:
		var coin := Node2D.new()
		coin.add_to_group(&"coins")
		coin.position = Vector2(110, 100)
		agent.get_parent().get_parent().add_child(coin)
		coins.append(coin)
	equal(nearest.members_of(&"coins").size(), 3, "all, in the first look of the tick")
	coins[0].free()
	equal(nearest.members_of(&"coins"), [coins[1], coins[2]] as Array[Node2D], "one is freed")
	coins[1].get_parent().remove_child(coins[1])
	equal(nearest.members_of(&"coins"), [coins[2]] as Array[Node2D], "one is out of the tree")
	coins[1].free()


func test_what_the_game_returns_comes_first() -> void:
	var agent := _agent(GAME + OBSERVES)
	var rays := LudusRays2D.new()
	rays.name = "Rays"
	rays.hit_groups = [&"a", &"b"]
	agent.get_parent().add_child(rays)
	equal(agent.connect_to_game(), "", "connect_to_game")
	equal(rays.count_values(), 48, "a distance and two groups for each ray")
	equal((agent.observer.get_observation() as Dictionary).keys(), ["observation", "Rays"], "")


func test_sensors_of_an_agent_below_are_its_own() -> void:
	var agent := _agent(GAME)
	var below := _agent(GAME)
	below.get_parent().reparent(agent.get_parent())
	for owner: LudusAgent in [agent, below]:
		var rays := LudusRays2D.new()
		owner.get_parent().add_child(rays)
		rays.name = "Rays"
	equal(agent.known_entries().size(), 1, "entries of the agent above")
	equal(below.known_entries().size(), 1, "entries of the agent below")


func test_mistakes_are_named() -> void:
	var agent := _agent(GAME)
	check("no method get_observation()" in agent.connect_to_game(), "without a sensor")
	var inner := Node2D.new()
	agent.get_parent().add_child(inner)
	for parent: Node in [inner, agent.get_parent()]:
		var rays := LudusRays2D.new()
		rays.name = "Rays"
		parent.add_child(rays)
	check("two sensors are called Rays" in agent.connect_to_game(), agent.connect_to_game())
	inner.free()
	equal(agent.connect_to_game(), "", "one of them")
	agent.get_parent().add_child(LudusGrid2D.new())
	check("has no values" in agent.connect_to_game(), agent.connect_to_game())


func test_rays_lie_as_they_should() -> void:
	var fan := LudusRays2D.new()
	fan.count = 3
	fan.spread = 90.0
	fan.reach = 2.0
	var ends := fan._ray_ends()
	check(ends[1].is_equal_approx(Vector2(2.0, 0.0)), "the middle one")
	check(ends[0].is_equal_approx(Vector2.from_angle(-PI / 4.0) * 2.0), "the first")
	fan.free()
	var cone := LudusRays3D.new()
	cone.count = 200
	var sum := Vector3.ZERO
	for end: Vector3 in cone._ray_ends():
		near(end.length(), cone.reach, 1e-4, "length")
		sum += end
	check(sum.length() < 0.02 * 200 * cone.reach, "all directions alike")
	cone.spread = 60.0
	for end: Vector3 in cone._ray_ends():
		check(rad_to_deg(end.angle_to(Vector3.FORWARD)) <= 30.01, "inside of the cone")
	cone.free()


func _agent(code: String) -> LudusAgent:
	var script := GDScript.new()
	script.source_code = code
	script.reload()
	var root := Node2D.new()
	var body := CharacterBody2D.new()
	body.set_script(script)
	body.position = Vector2(100, 100)
	var agent := LudusAgent.new()
	agent.action = [LudusActionComponent.new()]
	body.add_child(agent)
	root.add_child(body)
	add(root)
	LudusWorld.of(root)
	return agent


func near(got: float, expected: float, tolerance: float, what: String) -> void:
	check(absf(got - expected) <= tolerance, "%s: expected %f, got %f" % [what, expected, got])
