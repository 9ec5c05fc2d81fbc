extends "ludus_test.gd"
## Scenes that show the worlds instead of being one.

const WORLD_PATH := "res://examples/pendulum/pendulum.tscn"
const SOURCE := """extends Node
func ludus_world_scene() -> PackedScene:
	return load("%s") as PackedScene
"""


func test_a_scene_that_is_a_world_stays_one() -> void:
	var scene := load(WORLD_PATH) as PackedScene
	check(not LudusOuterScene.is_outer(scene), "it names no other")
	var num_children := tree.root.get_child_count()
	check(LudusOuterScene.enter(scene, tree) == scene, "it is the world")
	equal(tree.root.get_child_count(), num_children, "nothing is put on show")
	check(not LudusOuterScene.is_outer(_packed(Node.new())), "a root without a script")


func test_a_scene_that_names_another_is_put_on_show() -> void:
	var root := Node.new()
	root.name = "Outer"
	root.set_script(_script())
	var outer := _packed(root)
	check(LudusOuterScene.is_outer(outer), "it names another")
	equal(LudusOuterScene.enter(outer, tree).resource_path, WORLD_PATH, "the world")
	check(tree.current_scene != null and tree.current_scene.name == "Outer", "on show")


func _packed(root: Node) -> PackedScene:
	var scene := PackedScene.new()
	check(scene.pack(root) == OK, "a scene")
	root.free()
	return scene


func _script() -> GDScript:
	var script := GDScript.new()
	script.source_code = SOURCE % WORLD_PATH
	equal(script.reload(), OK, "the script")
	return script
