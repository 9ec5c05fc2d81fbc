extends RefCounted
## Base of all test files: every method whose name begins with [code]test_[/code] is a test.

## The tree, for tests that need nodes in it.
var tree: SceneTree
## Folder of the golden frames.
var golden_folder: String
## Number of checks that the current test has made.
var num_checks: int = 0
## What is wrong, one line each.
var failures: PackedStringArray = []


## Fails unless [param condition] holds.
func check(condition: bool, what: String) -> void:
	num_checks += 1
	if not condition:
		failures.append(what)


## Fails unless both are the same, type included.
func equal(got: Variant, expected: Variant, what: String) -> void:
	var is_equal: bool = typeof(got) == typeof(expected) and got == expected
	check(is_equal, "" if is_equal else _difference(got, expected, what))


func _difference(got: Variant, expected: Variant, what: String) -> String:
	return "%s: expected %s, got %s" % [what, var_to_str(expected), var_to_str(got)]


## Puts a node into the tree until the test ends.
func add(node: Node) -> void:
	tree.root.add_child(node)


## Presses or lets go of a key, as a person would.
func press(key: Key, is_down: bool) -> void:
	var event := InputEventKey.new()
	event.keycode = key
	event.physical_keycode = key
	event.pressed = is_down
	Input.parse_input_event(event)
	Input.flush_buffered_events()


## Returns the names of the tests of this file.
func list_tests() -> PackedStringArray:
	var names := PackedStringArray()
	for method: Dictionary in get_method_list():
		var method_name: String = method["name"]
		if method_name.begins_with("test_"):
			names.append(method_name)
	return names
