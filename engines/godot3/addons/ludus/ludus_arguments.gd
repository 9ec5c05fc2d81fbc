class_name LudusArguments
extends Reference
## What the command line tells the add-on (PROTOCOL.md §10, POLICY.md §5).

## Environment variable with the token of a game that a trainer has started.
const TOKEN_VARIABLE := "LUDUS_TOKEN"

## Addresses to connect to, in order.
var connect_to: Array = []
## Address to listen at; empty: do not listen.
var listen_at: String = ""
## The secret shared with the trainer; empty: the one of this user, on this machine.
var token: String = ""
## Scene to play by hand, without a trainer; empty: the game's own.
var play_scene: String = ""
## Process that must stay alive; 0: none.
var parent_pid: int = 0
## Policy files that play while no trainer is there, by policy name.
var policies: Dictionary = {}
## Whether those policies draw their actions.
var sample_actions: bool = false
## Whether every episode that ends is told on the standard error output.
var has_report: bool = false


## Reads the command line of this process.
func _init() -> void:
	for argument in OS.get_cmdline_args():
		var value: String = argument.substr(argument.find("=") + 1)
		match argument.split("=")[0]:
			"--ludus-connect":
				connect_to = Array(value.split(",", false))
			"--ludus-listen":
				listen_at = value
			"--ludus-play":
				play_scene = value
			"--ludus-token-file":
				token = _read_text(value).strip_edges()
			"--ludus-parent":
				parent_pid = int(value)
			"--ludus-policy":
				var split := value.find("=")
				policies[value.left(split)] = value.substr(split + 1)
			"--ludus-sample":
				sample_actions = true
			"--ludus-report":
				has_report = true
	if token.empty():
		token = OS.get_environment(TOKEN_VARIABLE)


## The token that a trainer at the other end has to know; empty if there is none. Godot 3 cannot see
## whose a file is, and who may read it: the trainer looks at that.
func token_for(is_local: bool) -> String:
	return _read_text(user_token_path()).strip_edges() if token.empty() and is_local else token


## Where trainers of this user, on this machine, keep their token (PROTOCOL.md §3).
static func user_token_path() -> String:
	var cache := OS.get_cache_dir()
	if OS.get_name() == "Windows":
		cache = OS.get_environment("LOCALAPPDATA").replace("\\", "/")
	return cache.plus_file("ludus/token")


## Whether the game was started by or for a trainer.
func has_trainer() -> bool:
	return not connect_to.empty() or not listen_at.empty()


static func _read_text(path: String) -> String:
	var file := File.new()
	if file.open(path, File.READ) != OK:
		return ""
	var text := file.get_as_text()
	file.close()
	return text
