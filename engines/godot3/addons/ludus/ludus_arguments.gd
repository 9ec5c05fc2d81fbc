class_name LudusArguments
extends Reference
## What the command line tells the add-on (PROTOCOL.md §10, POLICY.md §5).

## Addresses to connect to, in order.
var connect_to: Array = []
## Address to listen at; empty: do not listen.
var listen_at: String = ""
## The secret shared with a trainer on another machine.
var token: String = ""
## Scene to play by hand, without a trainer; empty: the game's own.
var play_scene: String = ""
## Process that must stay alive; 0: none.
var parent_pid: int = 0
## Policy files that play while no trainer is there, by policy name.
var policies: Dictionary = {}
## Whether those policies draw their actions.
var is_sampling: bool = false
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
				is_sampling = true
			"--ludus-report":
				has_report = true


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
