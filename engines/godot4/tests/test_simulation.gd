extends "policy_test.gd"
## Games in code: what their host makes of them, and when they are told what.

const LudusManualPlay := preload("res://addons/ludus/bridge/manual_play.gd")
const LudusPolicyBatch := preload("res://addons/ludus/agent/policy_batch.gd")
const LudusSimulationAgent := preload("res://addons/ludus/simulation/simulation_agent.gd")
const LudusSimulationBatch := preload("res://addons/ludus/simulation/simulation_batch.gd")
const LudusSimulationSeat := preload("res://addons/ludus/simulation/simulation_seat.gd")

const StubSimulation := preload("stub_simulation.gd")
const HERO := 0
const TARGET := 1


func test_the_host_makes_world_and_agents() -> void:
	var host := _host()
	equal(host.error, "", "error")
	check(LudusWorld.find_above(host.get_node("hero0")) == host.world, "the agents' world")
	for i: int in 2:
		var agent := host.get_node(["hero0", "target0"][i]) as LudusAgent
		equal(agent.connect_to_game(), "", "agent")
		equal(agent.policy_name, ["hero", "target"][i], "policy")
		equal([agent.action[0].n, agent.observation[0].shape[0]], [5, 2], "spaces")
		equal([agent.ticks_per_step, agent.max_episode_steps], [1, 9], "times")
		check(agent.settings == null and not agent.has_action_mask, "defaults")
		check(agent.has_manual_action() and not agent.has_truncation(), "optional methods")


func test_what_is_overridden() -> void:
	var simulation := StubSimulation.new()
	check(simulation.overrides(&"advance"), "advance")
	check(not simulation.overrides(&"clean_up"), "clean_up")
	check(not LudusSimulation.new().overrides(&"advance"), "the class itself")


func test_a_host_without_a_simulation_says_so() -> void:
	var host := LudusSimulationHost.new()
	add(host)
	check("simulation_script" in host.error, host.error)
	check(host.simulation == null and host.world == null, "nothing is made")
	host._physics_process(0.1)
	equal(host._get_configuration_warnings().size(), 1, "warnings")
	host.simulation_script = preload("stub_agent.gd")
	check("does not extend LudusSimulation" in host._get_configuration_warnings()[0], "warning")
	host.simulation_script = StubSimulation
	equal(host._get_configuration_warnings().size(), 0, "warnings")


func test_creation_comes_once_and_its_draws_do_not_count() -> void:
	var host := _host()
	var told: Array[PackedStringArray] = []
	for episode: int in 2:
		host.world.set_seed(3)
		told.append(_begin(host))
	equal(told[0], PackedStringArray(["create", "begin", told[0][2]]), "first episode")
	equal(told[1], PackedStringArray(["begin", told[0][2]]), "the same episode again")


func test_spaces() -> void:
	for layout: LudusWorld.Layout in LudusWorld.Layout.values():
		var is_shared := layout == LudusWorld.Layout.GRID
		var host := _host(LudusWorld.Episode.WORLD, layout)
		host.place(Vector3(30, 40, 50))
		_begin(host)
		var simulation := host.simulation
		var where := Vector3(30, 40, 50) if is_shared else Vector3.ZERO
		equal(simulation.offset_2d, Vector2(where.x, where.y), "2D offset")
		equal(simulation.offset_3d, where, "3D offset")
		check(not host.is_sharing(), "no space before the first use")
		check(simulation.space_2d().is_valid() and simulation.space_3d().is_valid(), "spaces")
		equal(simulation.space_2d() == host.get_world_2d().space, is_shared, "2D space")
		equal(
			simulation.space_3d() == host.get_viewport().find_world_3d().space,
			is_shared,
			"3D space"
		)
		equal(host.is_sharing(), is_shared, "sharing")
		var space := simulation.space_2d()
		check(simulation.space_2d() == space, "one space")
		host.free()


func test_the_projects_gravity() -> void:
	var host := _host()
	_begin(host)
	var gravity := PhysicsServer2D.AREA_PARAM_GRAVITY
	var value: Variant = PhysicsServer2D.area_get_param(host.simulation.space_2d(), gravity)
	equal(float(value), 980.0, "gravity")


func test_a_slow_beginning() -> void:
	var host := _host()
	var simulation := _stub(host)
	simulation.ticks_to_create = 2
	simulation.ticks_to_begin = 1
	equal(_begin(host), PackedStringArray(["create"]), "before the first tick")
	var seat := (host.get_node("hero0") as LudusSimulationAgent).seat
	for tick: int in 3:
		check(not host.world.is_ready and seat.is_idle, "not ready before tick %d" % tick)
		seat.apply_action(1)
		host._physics_process(0.1)
		tree.physics_frame.emit()
	check(host.world.is_ready and not seat.is_idle, "ready")
	equal(simulation.log.slice(0, 2), PackedStringArray(["create", "begin"]), "told")
	equal(simulation.log.size(), 3, "neither action nor advance before it is ready")
	tree.physics_frame.emit()
	host._physics_process(0.1)
	equal(simulation.log[-1], "advance", "goes on")


func test_a_paused_game_does_not_begin() -> void:
	var host := _host()
	_stub(host).ticks_to_begin = 1
	_begin(host)
	tree.paused = true
	tree.physics_frame.emit()
	check(not host.world.is_ready, "paused")
	tree.paused = false
	tree.physics_frame.emit()
	check(host.world.is_ready, "goes on")


func test_a_game_that_nobody_plays_begins_by_itself() -> void:
	var host := _host()
	host._physics_process(0.1)
	equal(_stub(host).log.slice(0, 2), PackedStringArray(["create", "begin"]), "first tick")
	host._physics_process(0.1)
	equal(_stub(host).log[-1], "advance", "second tick")


func test_a_world_begins_anew_when_all_that_are_played_have_ended() -> void:
	var host := _host()
	_begin(host)
	var simulation := _stub(host)
	var seats := _seats(host)
	for seat: LudusSimulationSeat in seats:
		seat.apply_action(2)
	host._physics_process(0.1)
	simulation.done[HERO] = true
	check(seats[HERO].is_done(), "done")
	seats[HERO].reset()
	check(seats[HERO].is_idle and not seats[HERO].is_done(), "waits")
	seats[HERO].apply_action(3)
	equal(simulation.log[-1], "advance", "who waits does nothing")
	simulation.done[TARGET] = true
	simulation.log.clear()
	seats[TARGET].reset()
	equal(simulation.log[0], "begin", "a new episode")
	check(not seats[HERO].is_idle and not seats[TARGET].is_idle, "both play")
	seats[HERO].reset()
	equal(simulation.log.count("begin"), 1, "no second beginning in one tick")


func test_an_agent_begins_alone() -> void:
	var host := _host(LudusWorld.Episode.AGENT)
	_begin(host)
	host._physics_process(0.1)
	_seats(host)[TARGET].reset()
	equal(_stub(host).log[-1], "begin 1", "told")


func test_batches_ask_simulations_as_they_ask_nodes() -> void:
	for is_done: bool in [true, false]:
		var frames: Array[PackedByteArray] = []
		for script: GDScript in [LudusPolicyBatch, LudusSimulationBatch]:
			frames.append(_frame_of_an_end(script, is_done))
		equal(frames[1], frames[0], "frames of an agent that is done: %s" % is_done)


func test_random_play_begins_anew_after_a_cut() -> void:
	var script := GDScript.new()
	script.source_code = """
extends "res://tests/stub_simulation.gd"
func is_truncated(_agent: int) -> bool: return true
"""
	script.reload()
	var host := LudusSimulationHost.new()
	host.simulation_script = script
	host.episode_mode = LudusWorld.Episode.AGENT
	add(host)
	_begin(host)
	host._physics_process(0.1)
	_stub(host).log.clear()
	var agent := host.get_node("target0") as LudusAgent
	agent.connect_to_game()
	var batch := LudusSimulationBatch.new("target", [agent], PackedInt32Array([0]), 0)
	batch.play_randomly(RandomNumberGenerator.new())
	equal(_stub(host).log.count("begin 1"), 1, "episodes")


func test_a_lost_host_is_noticed() -> void:
	var host := _host()
	_begin(host)
	var agent := host.get_node("hero0") as LudusAgent
	agent.connect_to_game()
	var batch := LudusSimulationBatch.new("hero", [agent], PackedInt32Array([0]), 0)
	batch.activate(0)
	host.free()
	batch.drop_leavers()
	batch.set_actions([1], [])
	batch.collect_outcomes()
	equal(batch.final_slots, PackedInt32Array([0]), "ended")
	equal(batch.error, "", "error")


func test_a_person_plays() -> void:
	var host := _host()
	var simulation := _stub(host)
	var manual := LudusManualPlay.new()
	simulation.wish = 3
	for tick: int in 3:
		manual.advance()
		host._physics_process(0.1)
	equal(simulation.log.count("begin"), 1, "beginnings")
	equal(simulation.log.count("0 does 3"), 2, "actions")
	equal(simulation.log.slice(-3), PackedStringArray(["0 does 3", "1 does 3", "advance"]), "order")
	simulation.wish = null
	manual.advance()
	equal(simulation.log[-1], "advance", "nobody plays")


func test_a_policy_plays_a_simulation() -> void:
	var golden := _golden("perceptron_tanh")
	var host := LudusSimulationHost.new()
	host.simulation_script = _fitting(golden)
	host.policies = {"stub": golden.policy}
	add(host)
	var simulation := host.simulation
	var player := _player()
	for tick: int in 3:
		_advance(player, 1)
		host._physics_process(0.1)
	equal(simulation.get("applied"), [] as Array[int], "not before it has begun")
	equal(simulation.get("num_seen"), 0, "nor is it observed")
	tree.physics_frame.emit()
	for step: int in golden.steps.size():
		var case: Dictionary = golden.steps[step]
		simulation.set("seen", PackedFloat32Array(case["observation"]["observation"][0]))
		_advance(player, 1)
		host._physics_process(0.1)
		equal((simulation.get("applied") as Array)[-1], int(case["discrete"][0][0]), "action")
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
var seen := PackedFloat32Array()
var applied: Array[int] = []
var num_begun := 0
var num_seen := 0
var is_over := false
func policy_names() -> PackedStringArray:
	return ["stub"]
func observation_entries(_name: String) -> Array[LudusObservationEntry]:
	return [LudusObservationEntry.create("observation", [%d])]
func action_components(_name: String) -> Array[LudusActionComponent]:
	return [LudusActionComponent.discrete("%s", %d)]
func begin_episode() -> void:
	is_over = false
	num_begun += 1
	if num_begun == 1:
		await ticked
func apply_action(_agent: int, action: Variant) -> void:
	applied.append(action)
func get_observation(_agent: int) -> Variant:
	num_seen += 1
	return seen
func is_done(_agent: int) -> bool:
	return is_over
"""
		% [read.entries[0].size(), read.components[0].name, read.components[0].n]
	)
	script.reload()
	return script


func _host(
	episode_mode: LudusWorld.Episode = LudusWorld.Episode.WORLD,
	layout: LudusWorld.Layout = LudusWorld.Layout.ISOLATED
) -> LudusSimulationHost:
	var host := LudusSimulationHost.new()
	host.simulation_script = StubSimulation
	host.episode_mode = episode_mode
	host.layout = layout
	add(host)
	return host


## What a batch tells of an agent that is done after one step, or cut off.
func _frame_of_an_end(batch_class: GDScript, is_done: bool) -> PackedByteArray:
	var host := _host()
	_begin(host)
	var agent := host.get_node("target0") as LudusAgent
	agent.connect_to_game()
	var members: Array[LudusAgent] = [agent]
	check(LudusSimulationBatch.fits(members), "fits")
	var worlds := PackedInt32Array([0])
	var batch: LudusPolicyBatch = batch_class.new("target", members, worlds, 1)
	batch.activate(0)
	batch.set_actions([4], [])
	_stub(host).done[TARGET] = is_done
	batch.collect_outcomes()
	equal(batch.final_slots, PackedInt32Array([0]), "ended")
	var frame := PackedByteArray()
	batch.append_to(frame)
	batch.activate(0)
	batch.append_to(frame)
	batch.append_final_to(frame)
	equal(_stub(host).log[-1], "1 does 4", "action")
	return frame


## Begins an episode, as a trainer does. Returns what the simulation was told.
func _begin(host: LudusSimulationHost) -> PackedStringArray:
	_stub(host).log.clear()
	host.world.begin_episode()
	host.world.episode_started.emit()
	for seat: LudusSimulationSeat in _seats(host):
		seat.reset()
	return _stub(host).log.duplicate()


func _stub(host: LudusSimulationHost) -> StubSimulation:
	return host.simulation as StubSimulation


func _seats(host: LudusSimulationHost) -> Array[LudusSimulationSeat]:
	var seats: Array[LudusSimulationSeat] = []
	for path: String in ["hero0", "target0"]:
		seats.append((host.get_node(path) as LudusSimulationAgent).seat)
	return seats
