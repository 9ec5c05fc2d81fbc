@tool
extends RefCounted
## Starts [code]ludus serve[/code], the Python side of a game that guides its own training.
##
## It ends by itself once the game has gone.

## Project setting with the path of the Python that has Ludus; empty: it is looked for.
const PYTHON_SETTING := "ludus/training/python"
## Environment variable with the same, for one machine.
const PYTHON_VARIABLE := "LUDUS_PYTHON"
const FOLDERS_ABOVE := 3
## Says "there" if Ludus is, without importing it. With [code]-P[/code], here and below,
## Python does not import from the folder that the game was started in.
const PROBE := "import importlib.util; importlib.util.find_spec('ludus') and print('there')"
## Says "ours" if an environment, and the folder it lies in, are this user's alone. A group may
## write if it is the user's own, of the same name, as on Debian and Fedora.
const IS_OURS := """
cd -- "$1" && real=$(pwd -P) || exit
own_group=$(id -gn)
[ "$own_group" = "$(id -un)" ] || own_group=
foreign=$(find -H "$1/.." "$real/.." "$real" "$real/bin" -prune \\
	\\( ! -user "$(id -u)" -o -perm -0002 -o -perm -0020 ! -group "${own_group:-0}" \\)) || exit
[ -z "$foreign" ] && echo ours
"""

## Why there is no trainer, or an empty text.
var error: String = ""

var _pid: int = 0
var _log_path: String = ""


## Starts the server at [param port], with runs and policies in these folders. Returns false and
## sets [member error] if that cannot be.
func start(port: int, runs: String, policies: String) -> bool:
	var python := find_python()
	if python.is_empty():
		return false
	if not make_folder(runs):
		error = "cannot make the folder %s" % runs
		return false
	_log_path = runs.path_join("serve.log")
	var arguments: PackedStringArray = ["-P", "-m", "ludus.cli", "serve", "--once"]
	arguments += PackedStringArray(["--port", str(port), "--runs", runs])
	arguments += PackedStringArray(["--policies", policies, "--log", _log_path])
	_pid = OS.create_process(python, arguments)
	if _pid <= 0:
		error = "cannot start %s" % python
	return _pid > 0


## Whether it was started and has ended since.
func has_ended() -> bool:
	return _pid > 0 and not OS.is_process_running(_pid)


## What became of a process that ended: the last line of its log.
func describe_end() -> String:
	var lines := FileAccess.get_file_as_string(_log_path).strip_edges().split("\n")
	var last := lines[-1] if not lines[-1].is_empty() else "it wrote nothing"
	return "ludus serve has ended: %s (%s)" % [last, _log_path]


## Returns a Python that has Ludus: that of the project setting or the environment variable, or else
## the first of the virtual environments around the project and those on the path. Empty, with
## [member error], if there is none.
func find_python() -> String:
	var chosen := str(ProjectSettings.get_setting(PYTHON_SETTING, ""))
	if chosen.is_empty():
		chosen = OS.get_environment(PYTHON_VARIABLE)
	if not chosen.is_empty():
		var path := ProjectSettings.globalize_path(chosen)
		if _has_ludus(path):
			return path
		error = "%s has no Ludus; run `%s -m pip install ludus-rl`" % [path, path]
		return ""
	for path: String in _candidates():
		if _has_ludus(path):
			return path
	error = (
		"no Python with Ludus was found; name one in the project setting %s, or run `ludus serve`"
		% PYTHON_SETTING
	)
	return ""


## Makes a folder that the editor does not look into, and Git neither.
static func make_folder(path: String) -> bool:
	if DirAccess.make_dir_recursive_absolute(path) != OK:
		return false
	for mark: String in [".gdignore", ".gitignore"]:
		if FileAccess.file_exists(path.path_join(mark)):
			continue
		var file := FileAccess.open(path.path_join(mark), FileAccess.WRITE)
		if file == null:
			return false
		if mark == ".gitignore":
			file.store_string("*\n")
	return true


## The virtual environments around the project and that of the terminal, Python on the path, and the
## one that installed the add-on.
func _candidates() -> PackedStringArray:
	var names: PackedStringArray = ["bin/python", "Scripts/python.exe"]
	var folders: PackedStringArray = []
	var folder := ProjectSettings.globalize_path("res://").trim_suffix("/")
	if folder.is_empty():
		folder = OS.get_executable_path().get_base_dir()
	for i: int in FOLDERS_ABOVE:
		var environment := folder.path_join(".venv")
		if DirAccess.dir_exists_absolute(environment) and _is_ours(environment):
			folders.append(environment)
		folder = folder.get_base_dir()
	folders.append(OS.get_environment("VIRTUAL_ENV"))
	var found: PackedStringArray = []
	for environment: String in folders:
		for name: String in names:
			var path := environment.path_join(name)
			if not environment.is_empty() and FileAccess.file_exists(path):
				found.append(path)
	return found + PackedStringArray(["python3", "python"]) + installer()


## The Python whose Ludus installed the add-on, from the user's configuration; empty if none did.
static func installer() -> PackedStringArray:
	var file := FileAccess.open(OS.get_config_dir().path_join("ludus/python"), FileAccess.READ)
	var path := file.get_line() if file != null else ""
	return PackedStringArray([path]) if FileAccess.file_exists(path) else PackedStringArray()


## Whether nobody but this user may change what an environment runs. Windows does not tell.
static func _is_ours(environment: String) -> bool:
	if OS.has_feature("windows"):
		return true
	if _first_line_of("sh", ["-c", IS_OURS, "sh", environment]) == "ours":
		return true
	var text := (
		"Ludus: %s is not used: it, or the folder it lies in, is another user's, or others may"
		+ " write there; if you trust it, name its Python in the project setting %s"
	)
	print(text % [environment, PYTHON_SETTING])
	return false


static func _has_ludus(python: String) -> bool:
	return _first_line_of(python, ["-P", "-c", PROBE]) == "there"


## What a program says first; empty if it cannot be started. Not by [method OS.execute], which has a
## shell read path and arguments first.
static func _first_line_of(path: String, arguments: PackedStringArray) -> String:
	var pipe := OS.execute_with_pipe(path, arguments)
	return "" if pipe.is_empty() else (pipe["stdio"] as FileAccess).get_line()
