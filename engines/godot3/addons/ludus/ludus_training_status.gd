class_name LudusTrainingStatus
extends Reference
## What the trainer tells the game about training, now and then (PROTOCOL.md §8).

## The trainer has told how training goes.
signal received(status)
## A policy is in another mode than before, or its mode is known for the first time.
signal policy_mode_changed(policy, mode)

var _modes: Dictionary = {}


## Takes in what came, and tells the game.
func take_in(status: Dictionary) -> void:
	var policies = status.get("policies")
	if policies is Dictionary:
		for policy in policies:
			_note(policy, policies[policy])
	emit_signal("received", status)


func _note(policy: String, told) -> void:
	var word = told.get("mode") if told is Dictionary else null
	var mode: int = LudusRequests.MODES.find(word) if word is String else -1
	if mode >= 0 and _modes.get(policy, -1) != mode:
		_modes[policy] = mode
		emit_signal("policy_mode_changed", policy, mode)
