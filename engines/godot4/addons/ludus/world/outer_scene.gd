extends RefCounted
## A scene that shows the worlds instead of being one.
##
## Its root has a method [code]ludus_world_scene() -> PackedScene[/code], which names the scene that
## worlds are copies of. When a trainer asks for such a scene, it is put on show once, beside the
## worlds, and stays when they are made anew.

const METHOD := &"ludus_world_scene"


## Returns what worlds are made of when a trainer asks for [param scene], and puts that on show if
## it is an outer one.
static func enter(scene: PackedScene, tree: SceneTree) -> PackedScene:
	if not is_outer(scene):
		return scene
	var root := scene.instantiate()
	tree.root.add_child(root)
	tree.current_scene = root
	return root.call(METHOD)


## Whether the root of a scene names another one that worlds are made of.
static func is_outer(scene: PackedScene) -> bool:
	var script := _root_script(scene)
	if script == null:
		return false
	for method: Dictionary in script.get_script_method_list():
		if method["name"] == METHOD:
			return true
	return false


## The script of the root, which may come from the scene that this one inherits.
static func _root_script(scene: PackedScene) -> Script:
	var state := scene.get_state()
	for i: int in state.get_node_property_count(0):
		if state.get_node_property_name(0, i) == &"script":
			return state.get_node_property_value(0, i) as Script
	var inherited := state.get_node_instance(0)
	return _root_script(inherited) if inherited != null else null
