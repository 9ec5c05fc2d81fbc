extends "ludus_test.gd"
## A game that guides its own training: the node, its keys and overlay, how fast time passes.

const LudusAutoload := preload("res://addons/ludus/bridge/ludus_bridge.gd")
const LudusGamePace := preload("res://addons/ludus/training/game_pace.gd")
const LudusGuidedTraining := preload("res://addons/ludus/training/guided_training.gd")
const LudusRegistry := preload("res://addons/ludus/bridge/registry.gd")
const LudusRequests := preload("res://addons/ludus/bridge/requests.gd")
const LudusStage := preload("res://addons/ludus/world/stage.gd")
const LudusTrainerProcess := preload("res://addons/ludus/training/trainer_process.gd")
const LudusTrainingKeys := preload("res://addons/ludus/training/training_keys.gd")
const LudusTrainingOverlay := preload("res://addons/ludus/training/training_overlay.gd")

const ACTION := &"ludus_start"


func test_a_request_needs_a_guided_trainer() -> void:
	var requests := LudusRequests.new()
	check(not requests.add_guided("start"), "nobody is there")
	requests.open(["requests"])
	check(not requests.add_guided("start"), "the trainer guides")
	requests.open(["requests", "guided"])
	check(requests.add_guided("start"), "the game guides")
	equal(requests.take(), [{"kind": "start"}] as Array[Dictionary], "what it asks")
	requests.add_guided("start")
	requests.close()
	equal(requests.take().size(), 0, "the trainer has gone")
	check(not requests.add_guided("start"), "afterwards")


func test_the_greeting_tells_of_the_run() -> void:
	var training := _training()
	training.run_name = "tag-2"
	training.num_worlds = 7
	training.checkpoint_every_updates = 0
	equal(training.to_json(), {"run": "tag-2", "num_worlds": 7}, "without numbered checkpoints")
	training.checkpoint_every_updates = 50
	equal(training.to_json()["checkpoint_every_updates"], 50, "with them")


func test_the_run_is_called_like_its_scene() -> void:
	var training := _training()
	training.scene_path = "res://some where/ball chäse.tscn"
	equal(training.to_json()["run"], "ball_ch_se", "a name that the trainer takes")


func test_a_world_that_is_trained_is_not_in_charge() -> void:
	var stage := LudusStage.new()
	add(stage)
	var training := _training()
	stage.add_child(training)
	check(not training.is_in_charge(), "under a stage")
	equal(training.get_child_count(), 0, "neither keys nor overlay")
	equal(training.state, LudusTraining.State.OFFLINE, "it looks for nobody")


func test_every_event_in_every_state() -> void:
	var state := LudusTraining.State
	var event := LudusGuidedTraining.Event
	var online := [state.STANDBY, state.TRAINING, state.PLAYING, state.OFFLINE]
	# SEARCH, FIND, STAND_BY, TRAIN, PLAY, LOSE
	var expected: Dictionary[int, Array] = {
		state.OFFLINE: [state.CONNECTING] + _repeated(state.OFFLINE, 5),
		state.CONNECTING:
		[state.CONNECTING, state.GREETING] + _repeated(state.CONNECTING, 3) + [state.OFFLINE],
		state.GREETING: _repeated(state.GREETING, 2) + online,
		state.STANDBY: _repeated(state.STANDBY, 2) + online,
		state.TRAINING: _repeated(state.TRAINING, 2) + online,
		state.PLAYING: _repeated(state.PLAYING, 2) + online,
	}
	equal(expected.keys(), state.values(), "all states")
	for before: LudusTraining.State in expected:
		var after := []
		for happens: LudusGuidedTraining.Event in event.values():
			var guided := LudusGuidedTraining.new(LudusRequests.new())
			guided.state = before
			guided.advance(happens)
			after.append(guided.state)
			guided.free()
		equal(after, expected[before], "after %s" % state.find_key(before))


func test_the_node_follows_what_the_trainer_tells() -> void:
	var training := _training()
	var guided := _connect(training)
	var told: Array[LudusTraining.State] = []
	training.state_changed.connect(told.append)
	_tell(_status("standby"))
	_tell(_status("standby"))
	_tell(_status("training", "began"))
	_tell(_status("playing"))
	equal(
		told,
		(
			[
				LudusTraining.State.STANDBY,
				LudusTraining.State.TRAINING,
				LudusTraining.State.PLAYING,
			]
			as Array[LudusTraining.State]
		),
		"every change once"
	)
	equal(training.message, "began", "an empty message leaves the last one")
	equal(training.modes["hero"], LudusBridge.PolicyMode.FROZEN, "the mode of a policy")
	guided.end("the lights went out", null)
	equal(training.state, LudusTraining.State.OFFLINE, "the trainer has gone")
	equal(training.message, "the lights went out", "why")
	equal(training.disconnect_reason, "the lights went out", "why, too")


func test_a_status_with_nonsense_changes_nothing() -> void:
	var training := _training()
	var guided := _connect(training)
	for nonsense: Dictionary in [
		{"policies": 3}, {"policies": {"hero": 3}}, {"message": 5, "state": []}, {}
	]:
		_tell(nonsense)
	equal(training.state, LudusTraining.State.GREETING, "the state")
	equal(training.modes.size(), 0, "the modes")
	equal(training.message, "", "the message")
	guided.end("", null)


func test_a_status_of_a_trainer_that_guides_is_not_ours() -> void:
	var training := _training()
	_use_own_bridge()
	add(training)
	_tell(_status("training"))
	equal(training.state, LudusTraining.State.OFFLINE, "the state")
	equal(training.status.size(), 0, "the status")


func test_what_is_refused_is_shown() -> void:
	var training := _training()
	_use_own_bridge()
	add(training)
	check(not training.start(), "nobody listens")
	check("no trainer is connected" in training.message, training.message)
	var requests := LudusRegistry.bridge.guided.requests
	requests.open(["requests", "guided"])
	requests.policy_names = ["hero"]
	check(not training.set_policy_mode("nobody", 0), "an unknown policy")
	equal(training.message, 'there is no policy "nobody"; the game has: hero', "why")
	check(training.set_policy_mode("hero", 0), "a known one")


func test_without_the_autoload() -> void:
	var training := _training()
	LudusRegistry.bridge = null
	add(training)
	training.connect_trainer()
	check(not training.start(), "nobody listens")
	check("the autoload Ludus is missing" in training.message, training.message)


func test_scenes_may_have_the_former_names() -> void:
	var training := LudusTraining.new()
	for former: StringName in LudusTraining.FORMER_NAMES:
		training.set(former, 0)
	equal(training.visible_worlds, 0, "num_drawn")
	check(not training.autostart, "starts_by_itself")
	check(not training.shortcuts_enabled, "has_keys")
	training.free()


func test_keys_are_input_actions() -> void:
	_forget_actions()
	LudusTrainingKeys.add_actions({})
	for action: StringName in _training().keys:
		equal(InputMap.action_get_events(action).size(), 1, str(action))
	equal(LudusTrainingKeys.describe(ACTION), "Shift+F3", "what people read")


func test_a_project_may_choose_other_keys() -> void:
	_forget_actions()
	InputMap.add_action(ACTION)
	InputMap.action_add_event(ACTION, _key(KEY_T))
	LudusTrainingKeys.add_actions({ACTION: null})
	equal(LudusTrainingKeys.describe(ACTION), "T", "the key of the project's input map")
	LudusTrainingKeys.add_actions({ACTION: _key(KEY_F12)})
	equal(LudusTrainingKeys.describe(ACTION), "F12", "the key that was chosen in the inspector")
	_forget_actions()


func test_no_usual_key_is_one_that_games_use() -> void:
	_forget_actions()
	LudusTrainingKeys.add_actions({})
	for key: Key in [KEY_UP, KEY_ENTER, KEY_KP_ENTER, KEY_2, KEY_3, KEY_O, KEY_7, KEY_8, KEY_F1]:
		for action: StringName in LudusTrainingKeys.USUAL_KEYS:
			check(not _key(key).is_action(action), "%s is taken by %s" % [key, action])


func test_keys_guide_the_training() -> void:
	_forget_actions()
	var training := _training()
	training.keys = {ACTION: _key(KEY_T)}
	_use_own_bridge()
	add(training)
	training.add_child(LudusTrainingKeys.new(training))
	press(KEY_T, true)
	check("no trainer" in training.message, training.message)
	_forget_actions()


func test_the_overlay_tells_what_people_need() -> void:
	var training := _training()
	training.shortcuts_enabled = true
	_forget_actions()
	var guided := _connect(training)
	LudusTrainingKeys.add_actions(training.keys)
	var overlay := LudusTrainingOverlay.new(training)
	training.add_child(overlay)
	_tell(_status("training", "saved a checkpoint"))
	overlay._process(0.1)
	var text := _text_of(overlay)
	for part: String in [
		"training", "update 12", "123.5k steps", "hero", "frozen", "return 2.50", "saved a"
	]:
		check(part in text, "%s in %s" % [part, text])
	check("Shift+F4 stop" in text, "the keys: " + text)
	guided.end("", null)


func test_a_python_that_is_none_is_named() -> void:
	ProjectSettings.set_setting(LudusTrainerProcess.PYTHON_SETTING, "/nowhere/python")
	var process := LudusTrainerProcess.new()
	check(not process.start(1, OS.get_user_data_dir(), OS.get_user_data_dir()), "it cannot start")
	check("/nowhere/python" in process.error, process.error)
	check("pip install" in process.error, "what to do: " + process.error)
	ProjectSettings.set_setting(LudusTrainerProcess.PYTHON_SETTING, null)


func test_no_shell_reads_the_path_of_a_python() -> void:
	var mark := OS.get_user_data_dir().path_join("a-shell-was-here")
	ProjectSettings.set_setting(LudusTrainerProcess.PYTHON_SETTING, "/nowhere/$(touch '%s')" % mark)
	var process := LudusTrainerProcess.new()
	equal(process.find_python(), "", "there is none")
	check(not FileAccess.file_exists(mark), "what the path says was done")
	DirAccess.remove_absolute(mark)
	ProjectSettings.set_setting(LudusTrainerProcess.PYTHON_SETTING, null)


func test_fast_time_leaves_the_length_of_a_tick() -> void:
	var ticks := Engine.physics_ticks_per_second
	var tick_s := Engine.time_scale / ticks
	var pace := LudusGamePace.new()
	pace._is_fixed = false
	add(pace)
	pace.is_fast = true
	check(Engine.physics_ticks_per_second > 10000, "more ticks than any machine can do")
	check(is_equal_approx(Engine.time_scale / Engine.physics_ticks_per_second, tick_s), "fast")
	pace.is_fast = false
	equal(Engine.physics_ticks_per_second, ticks, "as before")
	LudusPace.watch_at(12)
	equal(Engine.physics_ticks_per_second, 12, "slow enough to be watched")
	check(is_equal_approx(Engine.time_scale / Engine.physics_ticks_per_second, tick_s), "slow")
	LudusPace.watch_at(0)
	equal(Engine.physics_ticks_per_second, ticks, "and back")
	equal(Engine.time_scale, 1.0, "the scale, too")


func _forget_actions() -> void:
	for action: StringName in LudusTrainingKeys.USUAL_KEYS:
		if InputMap.has_action(action):
			InputMap.erase_action(action)


func _key(key: Key) -> InputEventKey:
	var event := InputEventKey.new()
	event.keycode = key
	event.pressed = true
	return event


## Puts another bridge in the place of the autoload, for the rest of the test.
func _use_own_bridge() -> void:
	LudusRegistry.bridge = null
	add(LudusAutoload.new())


## Lets a node guide a trainer that has told nothing yet.
func _connect(training: LudusTraining) -> LudusGuidedTraining:
	_use_own_bridge()
	add(training)
	var guided := LudusRegistry.bridge.guided
	training.connect_trainer()
	guided.message = ""
	guided.advance(LudusGuidedTraining.Event.FIND)
	return guided


func _tell(status: Dictionary) -> void:
	LudusRegistry.bridge._requests.take_in(status)


func _repeated(state: LudusTraining.State, count: int) -> Array:
	var states := []
	states.resize(count)
	states.fill(state)
	return states


func _training() -> LudusTraining:
	var training := LudusTraining.new()
	training.autostart = false
	training.shortcuts_enabled = false
	return training


func _status(state: String, message: String = "") -> Dictionary:
	return {
		"state": state,
		"message": message,
		"agent_steps": 123456.0,
		"updates": 12.0,
		"policies": {"hero": {"mode": "frozen", "mean_return": 2.5}},
	}


func _text_of(node: Node) -> String:
	var text := (node as Label).text + "\n" if node is Label else ""
	for child: Node in node.get_children():
		text += _text_of(child)
	return text
