class_name LudusRequests
extends Reference
## What the game asks of the trainer: a queue that the trainer empties between two steps
## (PROTOCOL.md §8).

## The capability that both sides must have.
const CAPABILITY := "requests"
## Requests that wait at most; one more and the oldest is dropped.
const MAX_WAITING := 256
const MAX_NAME_LENGTH := 128
## Words of the protocol, in the order of [enum LudusBridge.PolicyMode].
const MODES := ["train", "frozen", "deterministic"]

## Why requests are refused; empty: a trainer takes them.
var refusal: String = "no trainer is connected"
## The policies there are; empty as long as that is not known.
var policy_names: Array = []

var _waiting: Array = []
var _has_told_refusal: bool = false
var _has_told_overflow: bool = false


## Lets requests in, if the trainer takes them.
func open(capabilities: Array) -> void:
	if CAPABILITY in capabilities:
		refusal = ""
	else:
		refusal = "the trainer is too old; run `pip install --upgrade ludus-rl`"


## Asks for another mode of a policy. Returns false if that cannot be.
func set_mode(policy: String, mode: int) -> bool:
	if mode < 0 or mode >= MODES.size():
		return _complain("there is no policy mode %d" % mode)
	if not _is_policy(policy):
		var known := PoolStringArray(policy_names).join(", ")
		return _complain('there is no policy "%s"; the game has: %s' % [policy, known])
	return add({"kind": "set_mode", "policy": policy, "mode": MODES[mode]})


## Puts a request at the end of the queue; one that equals it and still waits is dropped, so that
## many worlds may ask for the same. Returns whether there is a trainer to ask.
func add(request: Dictionary) -> bool:
	if not refusal.empty():
		var is_new := not _has_told_refusal
		_has_told_refusal = true
		return _complain("%s is ignored: %s" % [request["kind"], refusal], is_new)
	_forget(request)
	if _waiting.size() == MAX_WAITING:
		if not _has_told_overflow:
			push_warning("ludus: the trainer takes no requests; the oldest is dropped")
		_has_told_overflow = true
		_waiting.pop_front()
	_waiting.append(request)
	return true


## Returns the requests, oldest first, and forgets them.
func take() -> Array:
	var taken := _waiting
	_waiting = []
	return taken


## What the queue adds to the flags of a [code]BATCH[/code] (PROTOCOL.md §7).
func flags() -> int:
	return 0 if _waiting.empty() else LudusWire.FLAG_REQUESTS


func _complain(text: String, is_told: bool = true) -> bool:
	if is_told:
		push_warning("ludus: " + text)
	return false


## In Godot 3 a dictionary equals only itself.
func _forget(request: Dictionary) -> void:
	for i in _waiting.size():
		if deep_equal(_waiting[i], request):
			_waiting.remove(i)
			return


func _is_policy(policy: String) -> bool:
	if policy_names.empty():
		return not policy.empty() and policy.length() <= MAX_NAME_LENGTH
	return policy in policy_names
