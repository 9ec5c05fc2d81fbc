extends Button
## One example in the gallery.

## Name of the example.
@export var title: String
## One line about it.
@export var line: String
## The scene to open.
@export_file("*.tscn") var scene_path: String


func _ready() -> void:
	(%Title as Label).text = title
	(%Line as Label).text = line


func _pressed() -> void:
	get_tree().change_scene_to_file(scene_path)
