extends SceneTree
## Runs all tests: [code]godot --headless --path engines/godot4 -s tests/run_tests.gd --
## --golden=FOLDER [--only=test_NAME.gd][/code]. Prints a line per failure and exits with 1 if there
## are any.

const LudusAutoload := preload("res://addons/ludus/bridge/ludus_bridge.gd")
const LudusRegistry := preload("res://addons/ludus/bridge/registry.gd")

const LudusTest := preload("ludus_test.gd")
const FOLDER := "res://tests"
## Worlds that get no seed draw theirs from the engine's generator, so each test sets that one.
const SEED := 1

var _num_passed: int = 0
var _num_failed: int = 0
var _autoload: LudusAutoload


func _initialize() -> void:
	# Nodes can enter the tree only when it runs.
	_run.call_deferred()


func _run() -> void:
	_autoload = LudusRegistry.bridge
	for file: String in DirAccess.get_files_at(FOLDER):
		if file.match(_argument("only", "test_*.gd")):
			_run_file(file)
	print("%d passed, %d failed" % [_num_passed, _num_failed])
	quit(0 if _num_failed == 0 and _num_passed > 0 else 1)


func _run_file(file: String) -> void:
	var script: GDScript = load(FOLDER.path_join(file))
	if script == null or not script.can_instantiate():
		_report(file, ["the file cannot be loaded"])
		return
	var listed: LudusTest = script.new()
	for test_name: String in listed.list_tests():
		seed(SEED)
		var test: LudusTest = script.new()
		test.tree = self
		test.golden_folder = _argument("golden", "")
		test.call(test_name)
		if test.num_checks == 0:
			test.failures.append("the test broke off, or checks nothing")
		_report("%s %s" % [file, test_name], test.failures)
		_clear()


func _report(where: String, failures: PackedStringArray) -> void:
	if failures.is_empty():
		_num_passed += 1
	else:
		_num_failed += 1
	for failure: String in failures:
		print("FAILED %s: %s" % [where, failure])


## Removes what a test has left in the tree, and what it has put in the place of the autoload.
func _clear() -> void:
	for child: Node in root.get_children():
		if child != _autoload:
			child.free()
	LudusRegistry.bridge = _autoload


func _argument(argument_name: String, default: String) -> String:
	var prefix := "--%s=" % argument_name
	for argument: String in OS.get_cmdline_user_args():
		if argument.begins_with(prefix):
			return argument.trim_prefix(prefix)
	return default
