extends "policy_test.gd"
## Games in code: what their host makes of them, and when they are told what.

const StubSimulation := preload("stub_simulation.gd")
const HERO := 0
const TARGET := 1


func test_the_host_makes_world_and_agents() -> void:
	var host := _host()
	equal(host.error, "", "error")
	check(LudusWorld.find_above(host.get_node("hero0")) == host.world, "the agents' world")
	for i in 2:
		var agent := host.get_node(["hero0", "target0"][i]) as LudusAgent
		equal(agent.connect_to_game(), "", "agent")
		equal(agent.policy_name, ["hero", "target"][i], "policy")
		equal([agent.action[0].n, agent.observation[0].shape[0]], [5, 2], "spaces")
		equal([agent.ticks_per_step, agent.max_episode_steps], [1, 9], "times")
		check(agent.settings == null and not agent.has_action_mask, "defaults")
		check(agent.has_manual_action() and not agent.has_truncation(), "optional methods")


func test_what_is_overridden() -> void:
	var simulation := StubSimulation.new()
	check(simulation.overrides("advance"), "advance")
	check(not simulation.overrides("clean_up"), "clean_up")
	check(not LudusSimulation.new().overrides("advance"), "the class itself")


func test_a_host_without_a_simulation_says_so() -> void:
	var host := LudusSimulationHost.new()
	add(host)
	check("simulation_script" in host.error, host.error)
	check(host.simulation == null and host.world == null, "nothing is made")
	host._physics_process(0.1)
	check("is empty" in host._get_configuration_warning(), "warning")
	host.simulation_script = preload("stub_agent.gd")
	check("does not extend LudusSimulation" in host._get_configuration_warning(), "warning")
	host.simulation_script = StubSimulation
	equal(host._get_configuration_warning(), "", "warnings")


func test_creation_comes_once_and_its_draws_do_not_count() -> void:
	var host := _host()
	var told := []
	for _episode in 2:
		host.world.set_seed(3)
		told.append(_begin(host))
	equal(told[0], ["create", "begin", told[0][2]], "first episode")
	equal(told[1], ["begin", told[0][2]], "the same episode again")


func test_spaces() -> void:
	for layout in [LudusWorld.Layout.ISOLATED, LudusWorld.Layout.GRID]:
		var is_shared: bool = layout == LudusWorld.Layout.GRID
		var host := _host(LudusWorld.Episode.WORLD, layout)
		host.place(Vector3(30, 40, 50))
		var _told := _begin(host)
		var simulation := host.simulation
		var where := Vector3(30, 40, 50) if is_shared else Vector3.ZERO
		equal(simulation.offset_2d, Vector2(where.x, where.y), "2D offset")
		equal(simulation.offset_3d, where, "3D offset")
		check(not host.is_sharing(), "no space before the first use")
		var ids := [simulation.space_2d().get_id(), simulation.space_3d().get_id()]
		check(ids[0] != 0 and ids[1] != 0, "spaces")
		equal(ids[0] == host.get_world_2d().space.get_id(), is_shared, "2D space")
		var shared_3d := host.get_viewport().find_world().space.get_id()
		equal(ids[1] == shared_3d, is_shared, "3D space")
		equal(host.is_sharing(), is_shared, "sharing")
		equal(simulation.space_2d().get_id(), ids[0], "one space")
		host.free()


func test_the_projects_gravity() -> void:
	var host := _host()
	var _told := _begin(host)
	var gravity := Physics2DServer.AREA_PARAM_GRAVITY
	var value = Physics2DServer.area_get_param(host.simulation.space_2d(), gravity)
	equal(float(value), 98.0, "gravity in two dimensions")
	value = PhysicsServer.area_get_param(
		host.simulation.space_3d(), PhysicsServer.AREA_PARAM_GRAVITY
	)
	equal("%.4f" % value, "3.7000", "gravity in three dimensions")


func test_bullet_keeps_no_more_spaces() -> void:
	var hosts := []
	for i in 127:
		var host := _host()
		hosts.append(host)
		var _told := _begin(host)
		check(host.simulation.space_3d().get_id() != 0, "space %d" % i)
		_told = _begin(host)
	equal(hosts[125].error, "", "126 spaces")
	check("Bullet can keep 126" in hosts[126].error, "one more: " + hosts[126].error)
	for host in hosts:
		host.free()
	var last := _host()
	var _told := _begin(last)
	check(last.simulation.space_3d().get_id() != 0, "they were freed")
	_told = _begin(last)
	equal(last.error, "", "and count no longer")


func test_a_slow_beginning() -> void:
	var host := _host()
	var simulation := _stub(host)
	simulation.ticks_to_create = 2
	simulation.ticks_to_begin = 1
	equal(_begin(host), ["create"], "before the first tick")
	var seat := (host.get_node("hero0") as LudusSimulationAgent).seat
	for tick in 3:
		check(not host.world.is_ready and seat.is_idle, "not ready before tick %d" % tick)
		seat.apply_action(1)
		host._physics_process(0.1)
		tree.emit_signal("physics_frame")
	check(host.world.is_ready and not seat.is_idle, "ready")
	equal(simulation.told.slice(0, 1), ["create", "begin"], "told")
	equal(simulation.told.size(), 3, "neither action nor advance before it is ready")
	tree.emit_signal("physics_frame")
	host._physics_process(0.1)
	equal(simulation.told[-1], "advance", "goes on")


func test_a_paused_game_does_not_begin() -> void:
	var host := _host()
	_stub(host).ticks_to_begin = 1
	var _told := _begin(host)
	tree.paused = true
	tree.emit_signal("physics_frame")
	check(not host.world.is_ready, "paused")
	tree.paused = false
	tree.emit_signal("physics_frame")
	check(host.world.is_ready, "goes on")


func test_a_game_that_nobody_plays_begins_by_itself() -> void:
	var host := _host()
	host._physics_process(0.1)
	equal(_stub(host).told.slice(0, 1), ["create", "begin"], "first tick")
	host._physics_process(0.1)
	equal(_stub(host).told[-1], "advance", "second tick")


func test_a_host_that_leaves_the_tree_creates_its_game_again() -> void:
	var host := _host()
	_stub(host).ticks_to_begin = 1
	for _coming in 2:
		_stub(host).told.clear()
		host._physics_process(0.1)
		equal(_stub(host).told, ["create", "begin"], "it comes")
		tree.root.remove_child(host)
		tree.emit_signal("physics_frame")
		equal(_stub(host).told.size(), 2, "it has left")
		add(host)


func test_a_world_begins_anew_when_all_that_are_played_have_ended() -> void:
	var host := _host()
	var _told := _begin(host)
	var simulation := _stub(host)
	var seats := _seats(host)
	for seat in seats:
		seat.apply_action(2)
	host._physics_process(0.1)
	simulation.done[HERO] = true
	check(seats[HERO].is_done(), "done")
	seats[HERO].reset()
	check(seats[HERO].is_idle and not seats[HERO].is_done(), "waits")
	seats[HERO].apply_action(3)
	equal(simulation.told[-1], "advance", "who waits does nothing")
	simulation.done[TARGET] = true
	simulation.told.clear()
	seats[TARGET].reset()
	equal(simulation.told[0], "begin", "a new episode")
	check(not seats[HERO].is_idle and not seats[TARGET].is_idle, "both play")
	seats[HERO].reset()
	equal(simulation.told.count("begin"), 1, "no second beginning in one tick")


func test_an_agent_begins_alone() -> void:
	var host := _host(LudusWorld.Episode.AGENT)
	var _told := _begin(host)
	host._physics_process(0.1)
	_seats(host)[TARGET].reset()
	equal(_stub(host).told[-1], "begin 1", "told")


func test_batches_ask_simulations_as_they_ask_nodes() -> void:
	for is_done in [true, false]:
		var frames := []
		for script in [LudusPolicyBatch, LudusSimulationBatch]:
			frames.append(_frame_of_an_end(script, is_done))
		equal(Array(frames[1]), Array(frames[0]), "frames of an agent that is done: %s" % is_done)


func test_a_lost_host_is_noticed() -> void:
	var host := _host()
	var _told := _begin(host)
	var agent := host.get_node("hero0") as LudusAgent
	equal(agent.connect_to_game(), "", "agent")
	var batch := LudusSimulationBatch.new("hero", [agent], PoolIntArray([0]), 0)
	batch.activate(0)
	host.free()
	batch.drop_leavers()
	batch.set_actions([1], [])
	batch.collect_outcomes()
	equal(Array(batch.final_slots), [0], "ended")
	equal(batch.error, "", "error")


func test_a_person_plays() -> void:
	var host := _host()
	var simulation := _stub(host)
	var manual := LudusManualPlay.new(tree)
	simulation.wish = 3
	for _tick in 3:
		manual.advance()
		host._physics_process(0.1)
	equal(simulation.told.count("begin"), 1, "beginnings")
	equal(simulation.told.count("0 does 3"), 2, "actions")
	equal(simulation.told.slice(-3, -1), ["0 does 3", "1 does 3", "advance"], "order")
	simulation.wish = null
	manual.advance()
	equal(simulation.told[-1], "advance", "nobody plays")


func test_a_policy_plays_a_simulation() -> void:
	var golden := _golden("perceptron_tanh")
	var host := LudusSimulationHost.new()
	host.simulation_script = _fitting(golden)
	host.policies = {"stub": golden.policy}
	add(host)
	var simulation := host.simulation
	var player := _player()
	for _tick in 3:
		_advance(player, 1)
		host._physics_process(0.1)
	equal(simulation.get("applied"), [], "not before it has begun")
	equal(simulation.get("num_seen"), 0, "nor is it observed")
	tree.emit_signal("physics_frame")
	for case in golden.steps:
		simulation.set("seen", PoolRealArray(case["observation"]["observation"][0]))
		_advance(player, 1)
		host._physics_process(0.1)
		equal(simulation.get("applied")[-1], int(case["discrete"][0][0]), "action")
	simulation.set("is_over", true)
	_advance(player, 1)
	equal(_ended.size(), 1, "episodes")
	equal(simulation.get("num_begun"), 2, "beginnings")


## A simulation with what the policy asks for, whose first episode takes a tick to begin.
func _fitting(golden: GoldenPolicy) -> GDScript:
	var read := golden.policy.reader()
	var script := GDScript.new()
	script.source_code = (
		"""extends LudusSimulation
var seen := PoolRealArray()
var applied := []
var num_begun := 0
var num_seen := 0
var is_over := false
func policy_names() -> PoolStringArray:
	return PoolStringArray(["stub"])
func observation_entries(_name: String) -> Array:
	return [LudusObservationEntry.create("observation", PoolIntArray([%d]))]
func action_components(_name: String) -> Array:
	return [LudusActionComponent.discrete("%s", %d)]
func begin_episode() -> void:
	is_over = false
	num_begun += 1
	if num_begun == 1:
		yield(self, "ticked")
func apply_action(_agent: int, action) -> void:
	applied.append(action)
func get_observation(_agent: int):
	num_seen += 1
	return seen
func is_done(_agent: int) -> bool:
	return is_over
"""
		% [read.entries[0].size(), read.components[0].name, read.components[0].n]
	)
	equal(script.reload(), OK, "the script")
	return script


func _host(
	episode_mode: int = LudusWorld.Episode.WORLD, layout: int = LudusWorld.Layout.ISOLATED
) -> LudusSimulationHost:
	var host := LudusSimulationHost.new()
	host.simulation_script = StubSimulation
	host.episode_mode = episode_mode
	host.layout = layout
	add(host)
	return host


## What a batch tells of an agent that is done after one step, or cut off.
func _frame_of_an_end(batch_class: GDScript, is_done: bool) -> PoolByteArray:
	var host := _host()
	var _told := _begin(host)
	var agent := host.get_node("target0") as LudusAgent
	equal(agent.connect_to_game(), "", "agent")
	check(LudusSimulationBatch.fits([agent]), "fits")
	var batch: LudusPolicyBatch = batch_class.new("target", [agent], PoolIntArray([0]), 1)
	batch.activate(0)
	batch.set_actions([4], [])
	_stub(host).done[TARGET] = is_done
	batch.collect_outcomes()
	equal(Array(batch.final_slots), [0], "ended")
	var bytes := batch.to_bytes()
	batch.activate(0)
	bytes.append_array(batch.to_bytes())
	bytes.append_array(batch.final_to_bytes())
	equal(_stub(host).told[-1], "1 does 4", "action")
	return bytes


## Begins an episode, as a trainer does. Returns what the simulation was told.
func _begin(host: LudusSimulationHost) -> Array:
	_stub(host).told.clear()
	host.world.begin_episode()
	host.world.emit_signal("episode_started")
	for seat in _seats(host):
		seat.reset()
	return _stub(host).told.duplicate()


func _stub(host: LudusSimulationHost) -> StubSimulation:
	return host.simulation as StubSimulation


func _seats(host: LudusSimulationHost) -> Array:
	var seats := []
	for path in ["hero0", "target0"]:
		seats.append((host.get_node(path) as LudusSimulationAgent).seat)
	return seats
