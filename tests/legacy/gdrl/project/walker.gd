extends Node
## A point on a line: beyond 3 its episode ends; after [member reset_after] ticks it begins again,
## and nobody is told. With [code]--is_lost=1[/code] it begins anywhere.

var policy_name := "walker"
var reset_after := 40
var needs_reset := false
var n_steps := 0
var heuristic := "human"

var _is_lost := OS.get_cmdline_args().has("--is_lost=1")
var _place := 0.0
var _speed := 0.0
var _reward := 0.0
var _is_done := false


func _ready() -> void:
	add_to_group("AGENT")
	var given := Array(OS.get_cmdline_args()).filter(
		func(argument: String) -> bool: return argument.begins_with("--reset_after=")
	)
	if given:
		reset_after = int((given[0] as String).get_slice("=", 1))


func _physics_process(_delta: float) -> void:
	n_steps += 1
	if needs_reset or n_steps > reset_after:
		_begin()
	_place += _speed
	_reward += _speed
	if _place > 3.0:
		_is_done = true
		_begin()


func get_obs_space() -> Dictionary:
	return {"obs": {"size": [3], "space": "box"}, "is_near": {"size": 2, "space": "discrete"}}


func get_obs() -> Dictionary:
	return {"obs": [_place, n_steps, _place > 0.0], "is_near": int(_place < 1.0)}


func get_action_space() -> Dictionary:
	return {
		"hop": {"size": 3, "action_type": "discrete"},
		"move": {"size": 2, "action_type": "continuous"}
	}


func set_action(action: Dictionary) -> void:
	_speed = (action["move"][0] + action["move"][1] + int(action["hop"])) / 4.0


func get_reward() -> float:
	return _reward


func zero_reward() -> void:
	_reward = 0.0


func get_done() -> bool:
	return _is_done


func set_done_false() -> void:
	_is_done = false


func set_heuristic(who: String) -> void:
	heuristic = who


func get_info() -> Dictionary:
	return {}


func get_name_and_policy() -> String:
	return "%s of %s" % [name, policy_name]


func get_arguments() -> Array:
	return OS.get_cmdline_args()


func _begin() -> void:
	needs_reset = false
	_place = randf() if _is_lost else 0.0
	n_steps = 0
