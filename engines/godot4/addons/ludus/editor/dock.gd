@tool
extends VBoxContainer
## The panel "Ludus" below the editor: checks and trains the scene that is edited, and evaluates,
## plays, films and exports runs, by the [code]ludus[/code] command.
## It looks for Python when it is shown for the first time, in a thread; the editor never waits.

const LudusCommand := preload("res://addons/ludus/editor/ludus_command.gd")
const LudusEnvironmentButton := preload("res://addons/ludus/editor/environment_button.gd")
const LudusOutputView := preload("res://addons/ludus/editor/output_view.gd")
const LudusPolicyAssignment := preload("res://addons/ludus/editor/policy_assignment.gd")
const LudusRunCurve := preload("res://addons/ludus/editor/run_curve.gd")
const LudusRunList := preload("res://addons/ludus/editor/run_list.gd")
const LudusTrainerProcess := preload("res://addons/ludus/training/trainer_process.gd")

const POLICIES := "res://policies"
const FILMS := "res://films"
const HEIGHT := 220.0
## What each button runs, and what its tooltip says.
const TOOLTIPS: Dictionary[String, String] = {
	"Check": "Checks that the scene behaves as an environment.",
	"Train": "Trains the agents of the scene that is edited, until the steps are used up.",
	"Stop": "Ends what runs; training is saved first. A second click ends it at once.",
	"Evaluate": "Plays 20 episodes with the chosen run and reports the returns.",
	"Play": "Shows the chosen run in a window; F4 shows what its agents see.",
	"Film": "Films an episode of the chosen run.",
	"Use policy":
	"Exports the policies of the chosen run, and gives them to the agents of this scene.",
}

var undo_redo: EditorUndoRedoManager
## What runs.
var command := LudusCommand.new()
var output := LudusOutputView.new()
var curve := LudusRunCurve.new()
## The buttons by their text.
var buttons: Dictionary[String, Button] = {}
var runs := LudusRunList.new()
var steps := SpinBox.new()
var flags := LineEdit.new()
var environment := LudusEnvironmentButton.new()

var _python: String = ""
var _arguments := PackedStringArray()
var _search := LudusTrainerProcess.new()
var _thread: Thread
var _place := Label.new()
var _progress := ProgressBar.new()
var _state := Label.new()


func _init() -> void:
	name = "Ludus"
	custom_minimum_size.y = HEIGHT
	command.line_written.connect(output.write)
	command.ended.connect(_on_ended)
	_build()


func _ready() -> void:
	set_process(false)  # until it is shown


func _exit_tree() -> void:
	command.stop()  # it saves what it has learnt, and ends by itself
	if _thread != null:
		_thread.wait_to_finish()
		_thread = null


func _notification(what: int) -> void:
	if what == NOTIFICATION_VISIBILITY_CHANGED:
		_wake.call_deferred()  # while the editor starts, panels come and go


func _process(_delta: float) -> void:
	if _thread != null and not _thread.is_alive():
		_take_python(_thread.wait_to_finish())
	command.poll()
	curve.poll()
	_show_state()


func _wake() -> void:
	if is_visible_in_tree() and not is_processing():
		set_process(true)
		find_python()
		list_runs()


## Looks for a Python that has Ludus, without waiting for it.
func find_python() -> void:
	if _thread != null:
		return
	_place.text = "Looking for Python …"
	_search.error = ""
	_thread = Thread.new()
	_thread.start(_search.find_python)


## Whether a command can be started.
func is_ready_to_start() -> bool:
	return not _python.is_empty() and not command.is_running()


## Lists the runs of this project, and shows the curve of the one that is chosen.
func list_runs(chosen: String = "") -> void:
	runs.refresh(chosen)
	if not command.is_running():
		curve.follow(runs.chosen_folder())


## Does what a button says.
func press(what: String) -> void:
	match what:
		"Check":
			_start(["check", _scene()])
		"Train":
			_train()
		"Stop":
			command.stop()
		"Evaluate":
			_start(["evaluate", runs.chosen_folder()])
		"Play":
			_start(["play", runs.chosen_folder()])
		"Film":
			_film()
		"Use policy":
			var folder := ProjectSettings.globalize_path(POLICIES)
			DirAccess.make_dir_recursive_absolute(folder)
			_start(["export", runs.chosen_folder(), "--to", folder])


func _train() -> void:
	var folder := ProjectSettings.globalize_path(LudusRunList.FOLDER)
	if not LudusTrainerProcess.make_folder(folder):
		output.write("error: cannot make the folder %s" % folder)
		return
	var time := Time.get_datetime_string_from_system().replace(":", "").replace("T", "-")
	var run_name := "%s-%s" % [_scene().get_file().get_basename(), time]
	var given := flags.text.split(" ", false)
	var arguments: PackedStringArray = ["train", _scene(), "--runs", folder, "--name", run_name]
	arguments += PackedStringArray(["--total-steps", str(int(steps.value))])
	if _start(arguments + given):
		curve.follow(folder.path_join(run_name))


func _film() -> void:
	var folder := ProjectSettings.globalize_path(FILMS)
	LudusTrainerProcess.make_folder(folder)
	var film := folder.path_join(runs.chosen_folder().get_file() + ".mp4")
	_start(["record", runs.chosen_folder(), "--episodes", "1", "--out", film])


func _start(arguments: PackedStringArray) -> bool:
	if not is_ready_to_start():
		return false
	if arguments[1].is_empty():
		output.write("error: save the scene first, or train a run")
		return false
	EditorInterface.save_all_scenes()
	return _start_with(_python, arguments + _godot())


func _start_with(python: String, arguments: PackedStringArray) -> bool:
	if command.is_running():
		return false
	_arguments = arguments
	output.clear()
	output.write("ludus " + " ".join(arguments))
	if not command.start(python, arguments):
		output.write("error: cannot start %s" % python)
	return command.is_running()


func _on_ended(exit_code: int) -> void:
	var what := _arguments[0]
	if command.is_stopping:
		output.write("%s was stopped" % what)  # its exit code tells no more than that
	else:
		var code := "" if exit_code == 0 else ", exit code %d" % exit_code
		output.write("%s has ended%s" % [what, code])
	if what == "addon":
		environment.take_end(_arguments, exit_code, output.get_parsed_text())
		find_python()
	if what == "train":
		curve.poll()
		list_runs(curve.run_name())
	if what == "export" and exit_code == 0:
		EditorInterface.get_resource_filesystem().scan()
		for line: String in LudusPolicyAssignment.assign(POLICIES, undo_redo):
			output.write(line)


func _take_python(found: Variant) -> void:
	_thread = null
	_python = str(found)
	_place.text = "Python: %s" % _python if not _python.is_empty() else _search.error
	_place.tooltip_text = _place.text


func _show_state() -> void:
	var is_running := command.is_running()
	for what: String in buttons:
		var needs_run := what in ["Evaluate", "Play", "Film", "Use policy"]
		buttons[what].disabled = _python.is_empty() or is_running
		if needs_run and runs.item_count == 0:
			buttons[what].disabled = true
	buttons["Stop"].disabled = not is_running
	environment.disabled = is_running
	_progress.visible = is_running
	if not is_running:
		_state.text = ""
		return
	var seconds := (Time.get_ticks_msec() - command.started_ms) / 1000
	_state.text = "%s%s, %d s" % [command.name, " stops" if command.is_stopping else "", seconds]
	_progress.indeterminate = command.name != "train"
	if command.name == "train":
		_progress.value = 100.0 * curve.agent_steps / maxf(steps.value, 1.0)
		_state.text += ", %d steps/s" % roundi(curve.steps_per_s)


func _build() -> void:
	var row := HBoxContainer.new()
	for what: String in TOOLTIPS:
		var button := Button.new()
		button.text = what
		button.tooltip_text = TOOLTIPS[what]
		button.pressed.connect(press.bind(what))
		buttons[what] = button
		row.add_child(button)
	runs.item_selected.connect(func(_i: int) -> void: curve.follow(runs.chosen_folder()))
	steps.min_value = 1000
	steps.max_value = 1000000000
	steps.step = 1000
	steps.value = 200000
	steps.suffix = "steps"
	steps.tooltip_text = "Agent steps of training."
	flags.placeholder_text = "more flags of ludus train"
	flags.custom_minimum_size.x = 180.0
	steps.custom_minimum_size.x = 150.0
	for control: Control in [runs, steps, flags]:
		row.add_child(control)
	_progress.custom_minimum_size.x = 120.0
	_progress.size_flags_vertical = Control.SIZE_SHRINK_CENTER
	row.add_child(_progress)
	row.add_child(_state)
	add_child(row)
	var split := HSplitContainer.new()
	split.size_flags_vertical = Control.SIZE_EXPAND_FILL
	curve.size_flags_horizontal = Control.SIZE_EXPAND_FILL
	curve.size_flags_stretch_ratio = 0.5
	split.add_child(output)
	split.add_child(curve)
	add_child(split)
	_build_place()


func _build_place() -> void:
	var row := HBoxContainer.new()
	_place.text_overrun_behavior = TextServer.OVERRUN_TRIM_ELLIPSIS
	_place.size_flags_horizontal = Control.SIZE_EXPAND_FILL
	_place.mouse_filter = Control.MOUSE_FILTER_PASS
	var again := Button.new()
	again.text = "Look again"
	again.tooltip_text = "Looks for a Python that has Ludus, see Project Settings > Ludus."
	again.pressed.connect(find_python)
	environment.command_wanted.connect(_start_with)
	for control: Control in [_place, again, environment]:
		row.add_child(control)
	add_child(row)


## The scene that is edited, or else the main one; empty if it was never saved.
func _scene() -> String:
	var root := EditorInterface.get_edited_scene_root()
	var path := str(ProjectSettings.get_setting("application/run/main_scene", ""))
	if root != null:
		path = root.scene_file_path
	return ProjectSettings.globalize_path(path) if not path.is_empty() else ""


## The flag that lets games run in the editor's own engine; none where that hides behind a loader.
static func _godot() -> PackedStringArray:
	var path := OS.get_executable_path()
	var is_known := "godot" in path.get_file().to_lower()
	return PackedStringArray(["--godot", path]) if is_known else PackedStringArray()
