class_name LudusArguments
extends Reference
## What the command line tells the add-on (PROTOCOL.md §10).

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
