extends Node
## A point on a line. It shows its place, the physics ticks since the reset, and the actions that
## were applied; its episode ends beyond 3. The environment variable WALK_FAULT names what goes
## wrong in the third step.

var place: float = 0.0
var num_ticks: int = 0
var num_actions: int = 0


func _physics_process(_delta: float) -> void:
	num_ticks += 1


## Moves the point; called once in every frame of a step.
func apply_action(action: Array) -> void:
	place += action[0]
	num_actions += 1


## Returns place, ticks and number of actions.
func get_observation() -> Array:
	if _is_now("script"):
		var nobody: Node = null
		return nobody.get_children()
	if _is_now("hang"):
		while true:
			pass
	if _is_now("nan"):
		return [NAN, 0, 0]
	return [place, num_ticks, num_actions]


## Returns minus infinity where that is the fault.
func get_reward() -> float:
	return -INF if _is_now("inf") else place / 2.0


## Returns whether the point is beyond 3.
func is_done() -> bool:
	if _is_now("quit"):
		OS.exit_code = 9
		get_tree().quit()
	return place > 3.0


## Puts the point back.
func reset() -> void:
	place = 0.0
	num_ticks = 0
	num_actions = 0


func _is_now(fault: String) -> bool:
	return num_actions == 6 and OS.get_environment("WALK_FAULT") == fault
