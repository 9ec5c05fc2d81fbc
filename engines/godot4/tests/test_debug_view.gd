extends "policy_test.gd"
## What the debug view knows of an agent that a policy in the game plays.

const LudusDebugPanel := preload("res://addons/ludus/debug/debug_panel.gd")
const LudusManualPlay := preload("res://addons/ludus/bridge/manual_play.gd")
const LudusRegistry := preload("res://addons/ludus/bridge/registry.gd")


func test_nothing_is_known_while_it_is_hidden() -> void:
	var view := _view()
	_agents(_golden("perceptron_tanh"), 1)
	_advance(_player(), 4)
	equal(view.get_child_count(), 0, "no panel is made")
	check(view.watched.batch == null and view.watched.rewards.is_empty(), "nothing is kept")
	view.free()


func test_what_is_seen_and_done_and_got() -> void:
	var golden := _golden("perceptron_tanh")
	var agents := _agents(golden, 2)
	var view := _view()
	view.show_view()
	var player := _player()
	for i: int in agents.size():
		agents[i].seen = PackedFloat32Array(
			golden.steps[0]["observation"]["observation"][i] as Array
		)
		agents[i].reward = 0.5 + i
	_advance(player, 1 + 2 * 3)
	for i: int in agents.size():
		var watched := view.watched
		equal(watched.agent(), agents[i], "whose it is")
		equal(watched.seen[0].to_float32_array(), agents[i].seen, "what it sees")
		equal(watched.choices[0], agents[i].applied[-1], "what it does")
		_check_odds(watched.probabilities, watched.choices[0])
		equal(watched.rewards[-1], 0.5 + i, "its reward")
		view.choose(1)
		_advance(player, 4)
	equal(view.watched.agent(), agents[0], "after the last comes the first")
	equal(view.watched.rewards.size(), 1, "of another agent nothing is kept")
	view.free()


func test_the_return_begins_anew_with_an_episode() -> void:
	var agent := _agents(_golden("perceptron_tanh"), 1)[0]
	agent.ticks_per_step = 1
	agent.max_episode_steps = 3
	agent.reward = 1.0
	var view := _view()
	view.show_view()
	_advance(_player(), 7)
	equal(Array(view.watched.returns), [1.0, 2.0, 3.0, 1.0, 2.0, 3.0], "returns")
	view.free()


func test_forbidden_choices_have_no_chance_and_numbers_a_spread() -> void:
	var golden := _golden("mixed")
	var agent := _agents(golden, 1)[0]
	var case: Dictionary = golden.steps[0]
	agent.mask = PackedByteArray(case["action_mask"][0] as Array)
	agent.seen = {}
	for name: String in case["observation"]:
		agent.seen[name] = case["observation"][name][0]
	var view := _view()
	view.show_view()
	_advance(_player(), 1)
	var watched := view.watched
	equal(watched.probabilities.size(), agent.mask.size(), "a number for each alternative")
	for i: int in agent.mask.size():
		check((watched.probabilities[i] == 0.0) == (agent.mask[i] == 0), "alternative %d" % i)
	equal(watched.means, watched.numbers, "the most probable numbers are the means")
	for deviation: float in watched.deviations:
		check(deviation > 0.0, "deviation %s" % deviation)
	view.free()


func test_a_person_sees_what_the_agent_would_see() -> void:
	var agent := Person.new()
	agent.action = [
		LudusActionComponent.discrete("jump", 2), LudusActionComponent.continuous("aim", 2)
	]
	agent.ticks_per_step = 1
	agent.seen = {"near": PackedFloat32Array([0.25, 0.5]), "far": PackedByteArray([7])}
	agent.reward = 2.0
	add(agent)
	var view := _view()
	view.show_view()
	var play := LudusManualPlay.new()
	for tick: int in 4:
		play.advance()
	var watched := view.watched
	equal(watched.agent(), agent as LudusAgent, "whose it is")
	equal(watched.entries.size(), 2, "entries")
	equal(watched.seen[0].to_float32_array(), PackedFloat32Array([0.25, 0.5]), "what it sees")
	equal(watched.choices, PackedInt64Array([1]), "the choice")
	equal(watched.numbers, PackedFloat32Array([0.5, -0.5]), "the numbers")
	equal(watched.rewards[-1], 2.0, "its reward")
	view.free()
	agent.free()


func test_keys_show_and_choose() -> void:
	var agents := _agents(_golden("perceptron_tanh"), 3)
	var view := _view()
	var player := _player()
	_tap(KEY_F4)
	check(view.visible, "F4 shows it")
	_advance(player, 1)
	_tap(KEY_F6)
	equal(view.watched.agent(), agents[1], "F6")
	_tap(KEY_F5)
	_tap(KEY_F5)
	equal(view.watched.agent(), agents[2], "F5 twice")
	_tap(KEY_F4)
	check(not view.visible, "F4 hides it")
	view.free()


func test_the_keys_of_a_scene_replace_those_of_the_autoload() -> void:
	var own := _view()
	own.show_view()
	var placed := LudusDebugView.new()
	var key := InputEventKey.new()
	key.keycode = KEY_F12
	placed.keys = {&"ludus_debug_view": key}
	add(placed)
	check(not own.visible, "only one is shown")
	_tap(KEY_F12)
	check(placed.visible and not own.visible, "its own key shows it")
	placed.free()
	equal(LudusRegistry.debug_view, own, "the other one is there again")
	own.free()
	InputMap.erase_action(&"ludus_debug_view")


func test_bounds_of_bars() -> void:
	var entry := LudusObservationEntry.create("rays", [3])
	equal(LudusDebugPanel.bounds_of(entry, [0.5, 2.0]), Vector2(0.0, 2.0), "no bounds")
	entry.low = -1.0
	entry.high = 1.0
	equal(LudusDebugPanel.bounds_of(entry, [0.5, 2.0]), Vector2(-1.0, 1.0), "its bounds")
	equal(entry.describe(), "rays  float32[3]  -1.0 to 1.0", "its line")


func _check_odds(odds: PackedFloat32Array, chosen: int) -> void:
	var sum := 0.0
	for one: float in odds:
		sum += one
		check(one <= odds[chosen], "the most probable one is taken")
	check(absf(sum - 1.0) < 1e-5, "they are %s in sum" % sum)


func _view() -> LudusDebugView:
	var view := LudusDebugView.new()
	add(view)
	return view


func _tap(key: Key) -> void:
	press(key, true)
	press(key, false)


class Person:
	extends StubAgent

	func get_manual_action() -> Variant:
		return {"jump": 1, "aim": PackedFloat32Array([0.5, -0.5])}
