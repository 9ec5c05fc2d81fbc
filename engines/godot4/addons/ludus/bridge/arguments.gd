extends RefCounted
## What the command line tells the add-on (PROTOCOL.md §10, POLICY.md §5).

const LudusArguments := preload("res://addons/ludus/bridge/arguments.gd")

## Addresses to connect to, in order.
var connect_to: PackedStringArray = []
## Address to listen at; empty: do not listen.
var listen_at: String = ""
## The secret shared with a trainer on another machine.
var token: String = ""
## Scene to play by hand, without a trainer; empty: the game's own.
var play_scene: String = ""
## Process that must stay alive; 0: none.
var parent_pid: int = 0
## Policy files that play while no trainer is there, by policy name.
var policies: Dictionary[String, String] = {}
## Whether those policies draw their actions.
var is_sampling: bool = false
## Whether the trainer may ask for pictures of worlds.
var has_pictures: bool = false
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
				arguments.is_sampling = true
			"--ludus-pictures":
				arguments.has_pictures = true
			"--ludus-report":
				arguments.has_report = true
	return arguments


## Whether the game was started by or for a trainer.
func has_trainer() -> bool:
	return not connect_to.is_empty() or not listen_at.is_empty()
