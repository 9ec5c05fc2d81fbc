extends Control
## Lists the examples; the one you choose begins at once.


func _ready() -> void:
	(%Cards.get_child(0) as Control).grab_focus()


func _unhandled_key_input(event: InputEvent) -> void:
	if event.is_action_pressed(&"ui_cancel"):
		get_tree().quit()
