extends RefCounted
## What the trainer tells the game about training, now and then (PROTOCOL.md §8).

## The trainer has told how training goes.
signal received(status: Dictionary)
## A policy is in another mode than before, or its mode is known for the first time.
signal policy_mode_changed(policy: String, mode: int)

const LudusRequests := preload("res://addons/ludus/bridge/requests.gd")

var _modes: Dictionary[String, int] = {}


## Takes in what came, and tells the game.
func take_in(status: Dictionary) -> void:
	var policies: Variant = status.get("policies")
	if policies is Dictionary:
		for policy: String in policies:
			_note(policy, policies[policy])
	received.emit(status)


func _note(policy: String, told: Variant) -> void:
	var word: Variant = (told as Dictionary).get("mode") if told is Dictionary else null
	var mode := LudusRequests.MODES.find(word) if word is String else -1
	if mode >= 0 and _modes.get(policy, -1) != mode:
		_modes[policy] = mode
		policy_mode_changed.emit(policy, mode)
