extends RefCounted
## The beginning of training: from a trainer that was found, over greeting and settings (PROTOCOL.md
## §3 and §4), to worlds that stand.

const LudusArguments := preload("res://addons/ludus/bridge/arguments.gd")
const LudusCameras := preload("res://addons/ludus/cameras/cameras.gd")
const LudusGame := preload("res://addons/ludus/world/game.gd")
const LudusGuidedTraining := preload("res://addons/ludus/training/guided_training.gd")
const LudusLink := preload("res://addons/ludus/bridge/link.gd")
const LudusStage := preload("res://addons/ludus/world/stage.gd")
const LudusWire := preload("res://addons/ludus/bridge/wire.gd")

const CONNECT_TIMEOUT_MS := 10000
const PLAY_CONNECT_TIMEOUT_MS := 300
const LISTEN_TIMEOUT_MS := 600000
const START_TIMEOUT_MS := 60000
const MAX_WORLDS := 65536
const MAX_SPIN_US := 100000
const LAYOUTS: PackedStringArray = ["scene", "isolated", "grid"]
const MAIN_SCENE_SETTING := "application/run/main_scene"

## The worlds, and the game they are; null as long as there are none.
var stage: LudusStage
var game: LudusGame
## What the trainer asked for; see PROTOCOL.md §3.
var config: Dictionary = {}
## The features that both sides have.
var capabilities: Array = []
## Code and text of what went wrong, and a hint; empty texts if nothing did.
var code: String = ""
var error: String = ""
var hint: String = ""

var _link: LudusLink
var _arguments: LudusArguments
var _scene: PackedScene


func _init(link: LudusLink, arguments: LudusArguments) -> void:
	_link = link
	_arguments = arguments


## Connects [param link] as the command line says; a game that runs in the editor looks for a
## trainer even if that says nothing. Returns whether there is one.
static func find_trainer(link: LudusLink, arguments: LudusArguments) -> bool:
	if not arguments.listen_at.is_empty():
		return link.listen_at(arguments, LISTEN_TIMEOUT_MS, hello({}))
	if arguments.has_trainer():
		return link.connect_to(arguments.connect_to, CONNECT_TIMEOUT_MS)
	if not OS.has_feature("editor"):
		return false
	var address := "tcp:127.0.0.1:%d" % LudusWire.DEFAULT_PORT
	return link.connect_to([address], PLAY_CONNECT_TIMEOUT_MS)


## Puts a scene on show in the place of [param bridge], for a person to play. Returns false if there
## is none.
static func show_scene(path: String, bridge: Node) -> bool:
	var scene := load(path) as PackedScene
	if scene == null:
		printerr("ludus: there is no scene %s" % path)
		return false
	var tree := bridge.get_tree()
	if tree.current_scene != bridge:
		tree.change_scene_to_packed(scene)
		return true
	var root := scene.instantiate()
	tree.root.add_child(root)
	tree.current_scene = root
	return true


## What the trainer is told first; [param training] is what a game that guides its training
## tells, empty where it does not.
static func hello(training: Dictionary) -> Dictionary:
	var version := Engine.get_version_info()
	var greeting := {
		"protocol": {"min": LudusWire.PROTOCOL_MIN, "max": LudusWire.PROTOCOL_MAX},
		"addon": LudusWire.ADDON_VERSION,
		"engine":
		{
			"name": "godot",
			"version": "%d.%d.%d" % [version["major"], version["minor"], version["patch"]],
		},
		"capabilities": Array(LudusWire.CAPABILITIES),
	}
	if not training.is_empty():
		greeting["training"] = training
	return greeting


## Greets the trainer, and loads the scene it asks for. Returns false if that cannot be.
func greet(guided: LudusGuidedTraining) -> bool:
	if take_settings(guided.to_json()):
		_scene = _load_scene(guided.scene_path())
	return _scene != null


## Greets the trainer and takes its settings; [param training] as of [method hello]. Returns false
## if they cannot work together.
func take_settings(training: Dictionary) -> bool:
	if not _link.is_proven and not _prove(training):
		return false
	_link.idle_timeout_ms = START_TIMEOUT_MS
	if not _link.receive():
		return _refuse("frame", "the trainer closed the connection during the greeting")
	var message: Variant = LudusWire.read_json(_link.payload)
	if _link.type == LudusWire.Type.ERROR and message != null:
		error = str(message.get("message", "the trainer refused"))
		hint = str(message.get("hint", ""))
		return false
	if _link.type != LudusWire.Type.WELCOME or message == null:
		return _refuse("sequence", "expected WELCOME, got a frame of type %d" % _link.type)
	return _accept(message)


## Makes the worlds it asks for, under [param parent]. Returns false if that cannot be.
func build(guided: LudusGuidedTraining, parent: Node) -> bool:
	guided.replace_current_scene()
	_make_stage(guided, parent)
	var max_steps := _integer("max_episode_steps", 0)
	if not game.open(max_steps, _integer("ticks_per_step", 0)):
		code = "config"
		error = "%s: %s" % [_scene.resource_path, game.error]
	elif not LudusCameras.find_problem().is_empty():
		code = "renderer"
		error = LudusCameras.find_problem()
		hint = LudusCameras.HINT
	return error.is_empty()


## The frame that tells the trainer what the game is.
func spec_frame() -> PackedByteArray:
	var spec := game.to_json()
	spec["scene"] = _scene.resource_path
	return LudusWire.json_frame(LudusWire.Type.SPEC, spec)


## Loads the scene the trainer asked for. Returns null and sets [member error] on failure.
func _load_scene(fallback: String) -> PackedScene:
	var path := str(config["scene"]) if config.get("scene") != null else fallback
	if path.is_empty():
		path = str(ProjectSettings.get_setting(MAIN_SCENE_SETTING, ""))
	if path.is_empty() or not ResourceLoader.exists(path, "PackedScene"):
		_refuse("config", 'there is no scene "%s" in the game' % path)
		return null
	var scene := load(path) as PackedScene
	if scene == null or not scene.can_instantiate():
		_refuse("config", "the scene %s cannot be loaded" % path)
		return null
	return scene


## An integer of the settings; [param default] where it is missing or null.
func _integer(key: String, default: int) -> int:
	var value: Variant = config.get(key)
	return int(value) if value is float or value is int else default


func _make_stage(guided: LudusGuidedTraining, parent: Node) -> void:
	var world_scene := LudusStage.show_viewer(_scene, parent.get_tree())
	stage = LudusStage.new()
	stage.name = "Stage"
	parent.add_child(stage)
	stage.configure(
		world_scene,
		_integer("num_worlds", 1),
		_integer("first_world", 0),
		str(config.get("layout", "scene"))
	)
	stage.has_pictures = LudusArguments.read().has_pictures
	stage.visible_worlds = guided.visible_worlds() if world_scene == _scene else 0
	game = LudusGame.new(stage)


func _prove(training: Dictionary) -> bool:
	var token := _arguments.token_for(_link.is_local)
	if not _link.is_local and token.length() < LudusLink.MIN_TOKEN_LENGTH:
		return _refuse("token", "a connection to another machine needs a token of 16 characters")
	var greeting := _link.greet(hello(training), token, START_TIMEOUT_MS)
	if not _link.is_proven:
		code = greeting.code
		hint = greeting.hint
		error = greeting.error
		if error.is_empty():
			error = "the trainer closed the connection during the greeting"
	return _link.is_proven


func _accept(welcome: Dictionary) -> bool:
	var chosen: Variant = welcome.get("protocol")
	var protocol := int(chosen) if chosen is float or chosen is int else 0
	if protocol < LudusWire.PROTOCOL_MIN or protocol > LudusWire.PROTOCOL_MAX:
		hint = "upgrade the add-on with `ludus addon install PROJECT`"
		return _refuse(
			"version", "the trainer chose protocol %d, which this add-on lacks" % protocol
		)
	var settings: Variant = welcome.get("config", {})
	if settings is not Dictionary:
		return _refuse("config", "config is no object")
	config = settings
	var common: Variant = welcome.get("capabilities")
	capabilities = common if common is Array else []
	var num_worlds := _integer("num_worlds", 1)
	if num_worlds < 1 or num_worlds > MAX_WORLDS:
		return _refuse("config", "num_worlds is %d, the limit is %d" % [num_worlds, MAX_WORLDS])
	var layout := str(config.get("layout", "scene"))
	if layout not in LAYOUTS:
		return _refuse("config", "layout is %s, expected %s" % [layout, " or ".join(LAYOUTS)])
	_link.idle_timeout_ms = _integer("idle_timeout_s", 3600) * 1000
	_link.spin_us = clampi(_integer("spin_us", 0), 0, MAX_SPIN_US)
	return true


func _refuse(why: String, message: String) -> bool:
	code = why
	error = message
	return false
