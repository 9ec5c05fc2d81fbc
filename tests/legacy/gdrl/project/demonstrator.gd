extends "res://walker.gd"
## A walker that a person can show how to walk; here the person holds two keys.

var control_mode := 4
var hop := 0
var move: Array[float] = [0.0, 0.0]


func _init() -> void:
	Input.action_press(&"ui_right", 0.5)
	Input.action_press(&"ui_accept")


func set_action(action = null) -> void:
	if action == null:
		move = [Input.get_axis(&"ui_left", &"ui_right"), -0.25]
		hop = 2 * int(Input.is_action_pressed(&"ui_accept"))
	else:
		move.assign(action["move"])
		hop = action["hop"]
	super({"move": move, "hop": hop})


func get_action() -> Array:
	return [hop, move[0], move[1]]
