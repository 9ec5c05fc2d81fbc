extends RefCounted
## The beginning of training: from a trainer that was found to worlds that stand.

const LudusArguments := preload("res://addons/ludus/bridge/arguments.gd")
const LudusCameras := preload("res://addons/ludus/cameras/cameras.gd")
const LudusGame := preload("res://addons/ludus/world/game.gd")
const LudusGuidedTraining := preload("res://addons/ludus/training/guided_training.gd")
const LudusHandshake := preload("res://addons/ludus/bridge/handshake.gd")
const LudusLink := preload("res://addons/ludus/bridge/link.gd")
const LudusOuterScene := preload("res://addons/ludus/world/outer_scene.gd")
const LudusStage := preload("res://addons/ludus/world/stage.gd")
const LudusWire := preload("res://addons/ludus/bridge/wire.gd")

const CONNECT_TIMEOUT_MS := 10000
const PLAY_CONNECT_TIMEOUT_MS := 300
const LISTEN_TIMEOUT_MS := 600000

## The worlds, and the game they are; null as long as there are none.
var stage: LudusStage
var game: LudusGame
## The features that both sides have.
var capabilities: Array = []
## Code and text of what went wrong, and a hint; empty texts if nothing did.
var code: String = ""
var error: String = ""
var hint: String = ""

var _handshake: LudusHandshake
var _scene: PackedScene


## Connects [param link] as the command line says; a game that runs in the editor looks for a
## trainer even if that says nothing. Returns whether there is one.
static func find_trainer(link: LudusLink, arguments: LudusArguments) -> bool:
	if not arguments.listen_at.is_empty():
		return link.listen_at(arguments, LISTEN_TIMEOUT_MS, LudusHandshake.hello({}))
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


## Greets the trainer, and loads the scene it asks for. Returns false if that cannot be.
func greet(link: LudusLink, arguments: LudusArguments, guided: LudusGuidedTraining) -> bool:
	_handshake = LudusHandshake.new(link, arguments, guided.to_json())
	if _handshake.greet():
		_scene = _handshake.load_scene(guided.scene_path())
	if _scene == null:
		code = _handshake.code
		error = _handshake.error
		hint = _handshake.hint
		return false
	capabilities = _handshake.capabilities
	return true


## Makes the worlds it asks for, under [param parent]. Returns false if that cannot be.
func build(guided: LudusGuidedTraining, parent: Node) -> bool:
	guided.replace_current_scene()
	_make_stage(guided, parent)
	var max_steps := _handshake.integer("max_episode_steps", 0)
	if not game.open(max_steps, _handshake.integer("ticks_per_step", 0)):
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


func _make_stage(guided: LudusGuidedTraining, parent: Node) -> void:
	var world_scene := LudusOuterScene.enter(_scene, parent.get_tree())
	stage = LudusStage.new()
	stage.name = "Stage"
	parent.add_child(stage)
	stage.configure(
		world_scene,
		_handshake.integer("num_worlds", 1),
		_handshake.integer("first_world", 0),
		str(_handshake.config.get("layout", "scene"))
	)
	stage.has_pictures = LudusArguments.read().has_pictures
	stage.visible_worlds = guided.visible_worlds() if world_scene == _scene else 0
	game = LudusGame.new(stage)
