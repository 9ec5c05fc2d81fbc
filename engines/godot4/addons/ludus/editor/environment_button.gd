@tool
extends Button
## Makes a virtual environment in [code].venv[/code] of the project, with the Ludus that installed
## the add-on: it asks for the size first, and then the person.

## A command is to be run with a Python.
signal command_wanted(python: String, arguments: PackedStringArray)

const LudusTrainerProcess := preload("res://addons/ludus/training/trainer_process.gd")
const SIZE := "--size"
const FOLDER := "res://.venv"

## The question, once the size is known.
var question := ConfirmationDialog.new()


func _init() -> void:
	text = "Make .venv …"
	tooltip_text = (
		"Makes a virtual environment in the project, with the Ludus that installed the add-on. "
		+ "Asks first, with the size; Stop takes back what there is by then."
	)
	question.title = "Make a virtual environment?"
	question.confirmed.connect(_ask_for.bind(PackedStringArray()))
	add_child(question)
	pressed.connect(_ask_for.bind(PackedStringArray([SIZE])))
	refresh()


## Shows the button where an environment can be made.
func refresh() -> void:
	var is_made := DirAccess.dir_exists_absolute(ProjectSettings.globalize_path(FOLDER))
	visible = not is_made and not LudusTrainerProcess.installer().is_empty()


## Asks the person, once a command has told the size.
func take_end(arguments: PackedStringArray, exit_code: int, output: String) -> void:
	refresh()
	if SIZE not in arguments or exit_code != 0:
		return
	for line: String in output.split("\n"):
		if " takes about " in line:
			question.dialog_text = line + ". It is downloaded, or comes from pip's cache."
	question.popup_centered()


func _ask_for(more: PackedStringArray) -> void:
	var project := ProjectSettings.globalize_path("res://").trim_suffix("/")
	var arguments := PackedStringArray(["addon", "environment", project]) + more
	command_wanted.emit(LudusTrainerProcess.installer()[0], arguments)
