extends RefCounted
## The JSON part of a conversation: greeting, settings, spec (PROTOCOL.md §3 and §4).

const LudusArguments := preload("res://addons/ludus/bridge/arguments.gd")
const LudusLink := preload("res://addons/ludus/bridge/link.gd")
const LudusWire := preload("res://addons/ludus/bridge/wire.gd")

const START_TIMEOUT_MS := 60000
const MAX_WORLDS := 65536
const MAX_SPIN_US := 100000
const LAYOUTS: PackedStringArray = ["scene", "isolated", "grid"]
const MAIN_SCENE_SETTING := "application/run/main_scene"

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
var _training: Dictionary


## [param training] is what a game that guides its training tells; empty where it does not.
func _init(link: LudusLink, arguments: LudusArguments, training: Dictionary) -> void:
	_link = link
	_arguments = arguments
	_training = training


## What the trainer is told first; [param training] as in [method _init].
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


## Greets the trainer and takes its settings. Returns false if they cannot work together.
func greet() -> bool:
	if not _link.is_proven and not _prove():
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


## Loads the scene the trainer asked for. Returns null and sets [member error] on failure.
func load_scene(fallback: String) -> PackedScene:
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
func integer(key: String, default: int) -> int:
	var value: Variant = config.get(key)
	return int(value) if value is float or value is int else default


func _prove() -> bool:
	var token := _arguments.token_for(_link.is_local)
	if not _link.is_local and token.length() < LudusLink.MIN_TOKEN_LENGTH:
		return _refuse("token", "a connection to another machine needs a token of 16 characters")
	var greeting := _link.greet(hello(_training), token, START_TIMEOUT_MS)
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
	var num_worlds := integer("num_worlds", 1)
	if num_worlds < 1 or num_worlds > MAX_WORLDS:
		return _refuse("config", "num_worlds is %d, the limit is %d" % [num_worlds, MAX_WORLDS])
	var layout := str(config.get("layout", "scene"))
	if layout not in LAYOUTS:
		return _refuse("config", "layout is %s, expected %s" % [layout, " or ".join(LAYOUTS)])
	_link.idle_timeout_ms = integer("idle_timeout_s", 3600) * 1000
	_link.spin_us = clampi(integer("spin_us", 0), 0, MAX_SPIN_US)
	return true


func _refuse(why: String, message: String) -> bool:
	code = why
	error = message
	return false
