extends RefCounted
## What game and trainer tell each other between two steps (PROTOCOL.md §8): the requests of the
## game, in a queue that the trainer empties, and how training goes.

## The trainer has told how training goes.
signal status_received(status: Dictionary)
## A policy is in another mode than before, or its mode is known for the first time.
signal policy_mode_changed(policy: String, mode: LudusBridge.PolicyMode)

const LudusWire := preload("res://addons/ludus/bridge/wire.gd")

## The capability that both sides must have.
const CAPABILITY := "requests"
## Requests that wait at most; one more and the oldest is dropped.
const MAX_WAITING := 256
const MAX_NAME_LENGTH := 128
## The capability of a trainer that the game guides.
const GUIDED_CAPABILITY := "guided"
## Words of the protocol, in the order of [enum LudusBridge.PolicyMode].
const MODES: PackedStringArray = ["train", "frozen", "deterministic"]

## Why requests are refused; empty: a trainer takes them.
var refusal: String = "no trainer is connected"
## Whether the trainer lets the game guide it.
var is_guided: bool = false
## Why the last request that was refused was refused.
var last_refusal: String = ""
## The policies there are; empty as long as that is not known.
var policy_names: PackedStringArray = []
## Mode of each policy whose mode the trainer has told, by name.
var modes: Dictionary[String, LudusBridge.PolicyMode] = {}

var _waiting: Array[Dictionary] = []
var _has_told_refusal: bool = false
var _has_told_overflow: bool = false


## Lets requests in, if the trainer takes them.
func open(capabilities: Array) -> void:
	modes.clear()
	is_guided = GUIDED_CAPABILITY in capabilities
	if CAPABILITY in capabilities:
		refusal = ""
	else:
		refusal = "the trainer is too old; run `pip install --upgrade ludus-rl`"


## Asks for another mode of a policy. Returns false if that cannot be.
func set_mode(policy: String, mode: int) -> bool:
	if mode < 0 or mode >= MODES.size():
		return _refuse("there is no policy mode %d" % mode)
	if not _is_policy(policy):
		var known := ", ".join(policy_names)
		return _refuse('there is no policy "%s"; the game has: %s' % [policy, known])
	return add({"kind": "set_mode", "policy": policy, "mode": MODES[mode]})


## Lets no more requests in, as the trainer has gone.
func close() -> void:
	refusal = "no trainer is connected"
	is_guided = false
	policy_names = []
	_waiting = []


## Asks for something that only a trainer does which the game guides. Returns whether there is one.
func add_guided(kind: String) -> bool:
	if refusal.is_empty() and not is_guided:
		return _refuse("%s is ignored: the game does not guide this trainer" % kind)
	return add({"kind": kind})


## Puts a request at the end of the queue; one that equals it and still waits is dropped, so that
## many worlds may ask for the same. Returns whether there is a trainer to ask.
func add(request: Dictionary) -> bool:
	if not refusal.is_empty():
		var is_new := not _has_told_refusal
		_has_told_refusal = true
		return _refuse("%s is ignored: %s" % [request["kind"], refusal], is_new)
	_waiting.erase(request)
	if _waiting.size() == MAX_WAITING:
		if not _has_told_overflow:
			push_warning("ludus: the trainer takes no requests; the oldest is dropped")
		_has_told_overflow = true
		_waiting.pop_front()
	_waiting.append(request)
	return true


## Returns the requests, oldest first, and forgets them.
func take() -> Array[Dictionary]:
	var taken := _waiting
	_waiting = []
	return taken


## What the queue adds to the flags of a [code]BATCH[/code] (PROTOCOL.md §7).
func flags() -> int:
	return 0 if _waiting.is_empty() else LudusWire.FLAG_REQUESTS


## Takes in how training goes, and tells the game.
func take_in(status: Dictionary) -> void:
	var policies: Variant = status.get("policies")
	if policies is Dictionary:
		for policy: String in policies:
			_note_mode(policy, policies[policy])
	status_received.emit(status)


func _note_mode(policy: String, told: Variant) -> void:
	var word: Variant = (told as Dictionary).get("mode") if told is Dictionary else null
	var mode := MODES.find(word) if word is String else -1
	if mode >= 0 and modes.get(policy, -1) != mode:
		modes[policy] = mode as LudusBridge.PolicyMode
		policy_mode_changed.emit(policy, mode)


func _refuse(text: String, is_told: bool = true) -> bool:
	last_refusal = text
	if is_told:
		push_warning("ludus: ", text)
	return false


func _is_policy(policy: String) -> bool:
	if policy_names.is_empty():
		return not policy.is_empty() and policy.length() <= MAX_NAME_LENGTH
	return policy in policy_names
