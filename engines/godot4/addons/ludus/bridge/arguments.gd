extends RefCounted
## What the command line tells the add-on (PROTOCOL.md §10, POLICY.md §5).

const LudusArguments := preload("res://addons/ludus/bridge/arguments.gd")

## Environment variable with the token of a game that a trainer has started.
const TOKEN_VARIABLE := "LUDUS_TOKEN"
## Rights of a file that others than its owner have.
const OTHERS := 63

## Addresses to connect to, in order.
var connect_to: PackedStringArray = []
## Address to listen at; empty: do not listen.
var listen_at: String = ""
## The secret shared with the trainer; empty: the one of this user, on this machine.
var token: String = ""
## Scene to play by hand, without a trainer; empty: the game's own.
var play_scene: String = ""
## Process that must stay alive; 0: none.
var parent_pid: int = 0
## Policy files that play while no trainer is there, by policy name.
var policies: Dictionary[String, String] = {}
## Whether those policies draw their actions.
var sample_actions: bool = false
## Whether the trainer may ask for pictures of worlds.
var has_pictures: bool = false
## Whether people who watch have keys for pause, single steps and slow motion.
var has_controls: bool = false
## Whether people see from the start what an agent sees and decides, as in a film.
var has_debug_view: bool = false
## Whether every episode that ends is told on the standard output.
var has_report: bool = false


## Reads the command line of this process.
static func read() -> LudusArguments:
	var arguments := LudusArguments.new()
	for argument: String in OS.get_cmdline_user_args() + OS.get_cmdline_args():
		var value := argument.get_slice("=", 1)
		match argument.get_slice("=", 0):
			"--ludus-connect":
				arguments.connect_to = value.split(",", false)
			"--ludus-listen":
				arguments.listen_at = value
			"--ludus-play":
				arguments.play_scene = value
			"--ludus-token-file":
				arguments.token = FileAccess.get_file_as_string(value).strip_edges()
			"--ludus-parent":
				arguments.parent_pid = value.to_int()
			"--ludus-policy":
				arguments.policies[value] = argument.trim_prefix("--ludus-policy=%s=" % value)
			"--ludus-sample":
				arguments.sample_actions = true
			"--ludus-pictures":
				arguments.has_pictures = true
			"--ludus-controls":
				arguments.has_controls = true
			"--ludus-debug-view":
				arguments.has_debug_view = true
			"--ludus-report":
				arguments.has_report = true
	if arguments.token.is_empty():
		arguments.token = OS.get_environment(TOKEN_VARIABLE)
	return arguments


## The token that a trainer at the other end has to know; empty if there is none.
func token_for(is_local: bool) -> String:
	return _read_user_token() if token.is_empty() and is_local else token


## Whether the game was started by or for a trainer.
func has_trainer() -> bool:
	return not connect_to.is_empty() or not listen_at.is_empty()


## Where trainers of this user, on this machine, keep their token (PROTOCOL.md §3).
static func user_token_path() -> String:
	var cache := OS.get_cache_dir()
	if OS.get_name() == "Windows":
		cache = OS.get_environment("LOCALAPPDATA").replace("\\", "/")
	return cache.path_join("ludus/token")


static func _read_user_token() -> String:
	var path := user_token_path()
	if not FileAccess.file_exists(path):
		return ""
	# Windows has no such rights; a home folder is its user's own there.
	if OS.get_name() != "Windows" and FileAccess.get_unix_permissions(path) & OTHERS != 0:
		printerr("ludus: others may read %s, so the token in it is no secret; delete it" % path)
		return ""
	return FileAccess.get_file_as_string(path).strip_edges()
