extends Reference
## Base of all test files: every method whose name begins with [code]test_[/code] is a test.

## The tree, for tests that need nodes in it.
var tree: SceneTree
## Folder of the golden frames.
var golden_folder: String
## Number of checks that the current test has made.
var num_checks: int = 0
## What is wrong, one line each.
var failures: Array = []


## Fails unless [param condition] holds.
func check(condition: bool, what: String) -> void:
	num_checks += 1
	if not condition:
		failures.append(what)


## Fails unless both are the same, type included.
func equal(got, expected, what: String) -> void:
	var is_equal := typeof(got) == typeof(expected) and deep_equal(got, expected)
	check(is_equal, "" if is_equal else "%s: expected %s, got %s" % [what, expected, got])


## Puts a node into the tree until the test ends.
func add(node: Node) -> void:
	tree.root.add_child(node)


## Returns the names of the tests of this file.
func list_tests() -> Array:
	var names := []
	for method in get_method_list():
		if method["name"].begins_with("test_"):
			names.append(method["name"])
	return names
