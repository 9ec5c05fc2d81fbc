class_name AIRunner
extends Node
## Joins an [AIBaseEnvironment] with the trainer: makes simulations, shows some of them, hears keys,
## tells how training goes.
##
## Rounds are played by [LudusClassicSimulation]s, in the worlds that the trainer asks for; without
## a trainer this node has worlds of its own, which stand still unless somebody plays them.

const LudusAutoload := preload("res://addons/ludus/bridge/ludus_bridge.gd")
const LudusRequests := preload("res://addons/ludus/bridge/requests.gd")

const WORLD_SCENE := "res://addons/ludus_classic/ludus_classic_world.tscn"
const POLICIES_FOLDER := "AIServerCommFiles"
const BRIDGE_PATH := ^"/root/Ludus"
## Ticks per second while people watch a round, as with godot-ai: 15 steps.
const WATCHED_TICKS := 30
## Epochs between two checkpoints that are kept for ever.
const KEPT_EPOCHS := 1000
const MAX_NAME_LENGTH := 64
## The input actions of [LudusTraining] that godot-ai has, and its keys.
const KEYS: Dictionary[StringName, Array] = {
	&"ludus_connect": [KEY_UP],
	&"ludus_play_round": [KEY_2, KEY_KP_2],
	&"ludus_start": [KEY_3, KEY_KP_3],
	&"ludus_stop": [KEY_ENTER, KEY_KP_ENTER],
	&"ludus_write_policies": [KEY_O],
}

## The environment.
var env_delegate: AIBaseEnvironment
## Finds a trainer when the game asks for one.
var training: LudusTraining = LudusTraining.new()
## The simulations of all worlds, in order.
var simulations: Array[LudusClassicSimulation] = []

var _ai_tcp: AIServerTCP = AIServerTCP.new()
## Epoch: rounds since training began, from 1.
var _loop_train_count: int = 1
var _is_loop_training: bool:
	get:
		return training.state == LudusTraining.State.TRAINING
## The games that nobody trains at the moment.
var _initial_simulations: Array[BaseSimulation]:
	get:
		return _list_games() if _are_games_free() else []

var _worlds: Node = Node.new()
## Whether worlds of our own are to be made.
var _is_setup_due: bool = false
## Whether a trainer has its worlds.
var _is_trained: bool = false
## A game that was made to be asked for its agents.
var _sample: BaseSimulation
var _agents: PackedStringArray = []
var _entries: Dictionary[String, LudusObservationEntry] = {}
var _components: Dictionary[String, LudusActionComponent] = {}
var _settings: Dictionary[String, LudusPolicySettings] = {}
## Frame in which they were asked for.
var _settings_frame: int = -1
## What was told last.
var _message: String = ""
## Whether the round of [member _loop_train_count] is being played.
var _is_in_round: bool = false
## Whether the console has the lines of [method _print_agents].
var _are_agents_printed: bool = false


## The scene that worlds are made of.
static func load_world_scene() -> PackedScene:
	return load(WORLD_SCENE) as PackedScene


func _ready() -> void:
	# So that keys are heard while the trainer thinks; worlds stand still then.
	process_mode = Node.PROCESS_MODE_ALWAYS
	if env_delegate.process_mode == Node.PROCESS_MODE_INHERIT:
		env_delegate.process_mode = Node.PROCESS_MODE_ALWAYS
	_worlds.process_mode = Node.PROCESS_MODE_PAUSABLE
	LudusClassicSimulation.runner = self
	_prepare_training()
	for child: Node in [_worlds, _ai_tcp, training]:
		add_child(child)
	var bridge := get_node_or_null(BRIDGE_PATH) as LudusAutoload
	if bridge != null:
		bridge.training_started.connect(_leave_to_trainer.unbind(1))
		bridge.training_status.connect(_take_in)


func _exit_tree() -> void:
	if LudusClassicSimulation.runner == self:
		LudusClassicSimulation.runner = null
	if _sample != null:
		_sample.cleanup_simulation()
		_sample = null


func _input(event: InputEvent) -> void:
	if not training.is_in_charge():
		return
	if event.is_action_pressed(&"ludus_connect"):
		training.connect_trainer()
	elif event.is_action_pressed(&"ludus_play_round"):
		training.play_round()
	elif event.is_action_pressed(&"ludus_start"):
		training.start()
	elif event.is_action_pressed(&"ludus_stop"):
		training.stop()
	elif event.is_action_pressed(&"ludus_write_policies"):
		training.write_policies()


func _process(_delta: float) -> void:
	_tell(training.message)
	if DisplayServer.get_name() != "headless" and not simulations.is_empty():
		_display()


func _physics_process(_delta: float) -> void:
	if _is_setup_due and not _is_trained:
		_is_setup_due = false
		var scene := load_world_scene()
		for i: int in env_delegate.get_simulation_count():
			_worlds.add_child(scene.instantiate())


## Makes worlds to look at, and to play by hand, unless a trainer has its own.
func setup_simulations() -> void:
	_is_setup_due = true


## The name of each agent of a game, by index.
func agents() -> PackedStringArray:
	if _agents.is_empty():
		_sample = env_delegate.new_simulation()
		for i: int in _sample.get_agents_count():
			_agents.append(_sample.get_agent_name(i))
	return _agents


## Makes a game.
func new_simulation() -> BaseSimulation:
	var made := _sample if _sample != null else env_delegate.new_simulation()
	_sample = null
	return made


## What the agents of a name see.
func observation_entry(agent_name: String) -> LudusObservationEntry:
	if not _entries.has(agent_name):
		var size := env_delegate.get_state_dim(agent_name)
		_entries[agent_name] = LudusObservationEntry.create("state", [size])
	return _entries[agent_name]


## What they decide.
func action_component(agent_name: String) -> LudusActionComponent:
	if not _components.has(agent_name):
		var size := env_delegate.get_action_dim(agent_name)
		_components[agent_name] = LudusActionComponent.continuous("action", size)
	return _components[agent_name]


## How they are trained. Worlds that are made in one frame have the same settings.
func settings(agent_name: String) -> LudusPolicySettings:
	if _settings_frame != Engine.get_process_frames():
		_settings_frame = Engine.get_process_frames()
		_settings.clear()
		for own_name: String in agents():
			_settings[own_name] = LudusClassicSettings.of(env_delegate, own_name)
	return _settings[agent_name]


func _prepare_training() -> void:
	var folder := "res://" if OS.has_feature("editor") else "user://"
	training.run_name = _run_name()
	training.scene_path = WORLD_SCENE
	training.num_worlds = env_delegate.get_simulation_count()
	training.visible_worlds = 0
	training.checkpoint_every_updates = KEPT_EPOCHS
	training.autostart = false
	training.has_overlay = false
	training.shortcuts_enabled = false
	training.policies_folder = folder + POLICIES_FOLDER
	training.state_changed.connect(_follow)
	_add_actions()


## Adds the actions that the project does not have, with the keys of godot-ai.
static func _add_actions() -> void:
	for action: StringName in KEYS:
		if InputMap.has_action(action):
			continue
		InputMap.add_action(action)
		for key: Key in KEYS[action]:
			var event := InputEventKey.new()
			event.keycode = key
			InputMap.action_add_event(action, event)


## The name of the scene, as far as a run may be called so.
func _run_name() -> String:
	var file_name := env_delegate.scene_file_path.get_file().get_basename()
	var others := RegEx.create_from_string("[^A-Za-z0-9_]")
	return others.sub(file_name, "_", true).left(MAX_NAME_LENGTH)


## The trainer's worlds take the place of ours.
func _leave_to_trainer() -> void:
	_is_trained = true
	for world: Node in _worlds.get_children():
		world.queue_free()


func _follow(state: LudusTraining.State) -> void:
	if DisplayServer.get_name() != "headless":
		LudusPace.watch_at(WATCHED_TICKS if state == LudusTraining.State.PLAYING else 0)
	if state == LudusTraining.State.OFFLINE and _is_trained:
		_is_trained = false
		_is_in_round = false
		_are_agents_printed = false
		setup_simulations()


func _take_in(status: Dictionary) -> void:
	_print_agents(status)
	var state := str(status.get("state", "training"))
	var epoch := int(status.get("updates", 0)) + 1
	if _is_in_round and epoch > _loop_train_count:
		_end_round()
	_loop_train_count = epoch
	_message = str(status.get("message", ""))
	if state != "training":
		_is_in_round = false
		var words := state if _message.is_empty() else "%s: %s" % [state, _message]
		env_delegate.update_status(epoch, words)
	elif not _is_in_round:
		_begin_round(status.get("policies", {}))


## Says in the console, once for each trainer, what the server of godot-ai said of every agent.
func _print_agents(status: Dictionary) -> void:
	if _are_agents_printed:
		return
	_are_agents_printed = true
	var steps := int(status.get("agent_steps", 0))
	for agent_name: String in env_delegate.get_agent_names():
		print("Replay Capacity: ", env_delegate.get_replay_capacity(agent_name))
		print("Agent named ", agent_name, " initialized.")
		if steps > 0:
			print("Checkpoint loaded for ", agent_name, ": ", steps, " agent steps")
		else:
			print("Checkpoint not loaded for: ", agent_name, " (there is none)")


## The trainer tells of an epoch when it is over: it has learned while the round was played.
func _end_round() -> void:
	_is_in_round = false
	for words: String in ["submitting", "training", "Done Training"]:
		env_delegate.update_status(_loop_train_count, words)


func _begin_round(policies: Dictionary) -> void:
	_is_in_round = true
	print("Epoch: ", _loop_train_count)
	env_delegate.update_status(_loop_train_count, "playing")
	_ask_for_modes(env_delegate.get_is_deterministic_map(_loop_train_count), policies)


## Asks for the modes that the environment wants, where they are others.
func _ask_for_modes(map: Dictionary, policies: Dictionary) -> void:
	for agent_name: String in policies:
		var wanted := _mode(map, agent_name)
		var word: Variant = (policies[agent_name] as Dictionary).get("mode")
		if LudusRequests.MODES[wanted] != word:
			training.set_policy_mode(agent_name, wanted)


static func _mode(map: Dictionary, agent_name: String) -> LudusBridge.PolicyMode:
	if map.get(agent_name, false):
		return LudusBridge.PolicyMode.DETERMINISTIC
	return LudusBridge.PolicyMode.TRAIN


## Shows the first simulations, always in the same order, unless one of them is about to begin.
func _display() -> void:
	var shown: Array[BaseSimulation] = []
	for i: int in env_delegate.get_number_of_simulations_to_display():
		var simulation := simulations[i % simulations.size()]
		if not simulation.world.is_ready:
			return
		shown.append(simulation.game)
	for game: BaseSimulation in shown:
		env_delegate.display_simulation(game)


## Tells what happens while there is no trainer.
func _tell(message: String) -> void:
	if message == _message or _is_trained:
		return
	_message = message
	env_delegate.update_status(_loop_train_count, message)


func _are_games_free() -> bool:
	if not _is_trained:
		return true
	return training.state == LudusTraining.State.STANDBY


func _list_games() -> Array[BaseSimulation]:
	var games: Array[BaseSimulation] = []
	for simulation: LudusClassicSimulation in simulations:
		if simulation.world.is_ready:
			games.append(simulation.game)
	return games
