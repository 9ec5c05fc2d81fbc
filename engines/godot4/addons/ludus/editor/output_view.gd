@tool
extends RichTextLabel
## What commands write. Scripts, scenes and nodes in it are links that open them.

const MAX_LINES := 2000
const COLOURS: Dictionary[String, String] = {
	"FAIL": "#ff6b6b", "warn": "#ffd166", "hint:": "#7fc8f8", "error:": "#ff6b6b"
}

## A file with a line or without, and a node below an agent's world.
var _places := RegEx.create_from_string("res://[^\\s:()\"'`,;]+(:\\d+)?|\\bagent [\\w@/.]+")


func _init() -> void:
	selection_enabled = true
	scroll_following = true
	focus_mode = Control.FOCUS_CLICK
	size_flags_horizontal = Control.SIZE_EXPAND_FILL
	size_flags_vertical = Control.SIZE_EXPAND_FILL
	meta_clicked.connect(open_place)


## Writes one line.
func write(line: String) -> void:
	if get_paragraph_count() > MAX_LINES:
		remove_paragraph(0)
	var colour := ""
	var head := line.strip_edges().get_slice(" ", 0)
	if COLOURS.has(head):
		colour = COLOURS[head]
		push_color(Color(colour))
	var at := 0
	for found: RegExMatch in _places.search_all(line):
		add_text(line.substr(at, found.get_start() - at))
		push_meta(found.get_string())
		add_text(found.get_string())
		pop()
		at = found.get_end()
	add_text(line.substr(at))
	if not colour.is_empty():
		pop()
	newline()


## Opens what a link names: a script at its line, a scene, or a node of the scene that is edited.
func open_place(place: Variant) -> void:
	var text := str(place)
	if text.begins_with("agent "):
		_select_node(text.trim_prefix("agent "))
		return
	var path := text.get_slice(":", 0) + ":" + text.get_slice(":", 1)
	var line := text.get_slice(":", 2).to_int() if text.count(":") > 1 else -1
	if not ResourceLoader.exists(path):
		return
	var resource := load(path)
	if resource is Script:
		EditorInterface.edit_script(resource as Script, line)
		EditorInterface.set_main_screen_editor("Script")
	elif resource is PackedScene:
		EditorInterface.open_scene_from_path(path)
	elif resource != null:
		EditorInterface.edit_resource(resource)


## A path inside the world; the world is the scene, or a part of it.
func _select_node(path: String) -> void:
	var root := EditorInterface.get_edited_scene_root()
	if root == null:
		return
	var node := root.get_node_or_null(path)
	if node == null:
		node = root.find_child(path.get_file(), true, false)
	if node != null:
		EditorInterface.get_selection().clear()
		EditorInterface.get_selection().add_node(node)
		EditorInterface.edit_node(node)
