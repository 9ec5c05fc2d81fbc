extends RefCounted
## Turns what a network puts out into actions (POLICY.md §4), for the slots of one batch.

const LudusPolicyReader := preload("res://addons/ludus/policy/policy_reader.gd")

## The choices of all slots.
var discrete: PackedInt64Array = []
## The numbers of all slots, within their bounds.
var continuous: PackedFloat32Array = []
## Alternatives of all choices in sum.
var num_logits: int = 0

var _nvec: PackedInt32Array = []
var _low: PackedFloat32Array
var _high: PackedFloat32Array
var _deviations: PackedFloat32Array = []
var _log_std_low: float
var _log_std_high: float
var _is_squashed: bool


func _init(read: LudusPolicyReader) -> void:
	for part: LudusActionComponent in read.components:
		if part.kind == LudusActionComponent.Kind.DISCRETE:
			_nvec.append(part.n)
	num_logits = read.num_logits
	_low = read.low
	_high = read.high
	for value: float in read.log_std:
		_deviations.append(exp(value))
	_log_std_low = read.log_std_range[0]
	_log_std_high = read.log_std_range[1]
	_is_squashed = read.is_squashed


## Gives room for the actions of [param num_slots] slots.
func reserve(num_slots: int) -> void:
	discrete.resize(num_slots * _nvec.size())
	continuous.resize(num_slots * _low.size())


## Decides for one slot, from the outputs that begin at [param from]. Without [param rng] it takes
## what is most probable. [param masks] of all slots may be empty: everything is allowed.
func choose(
	outputs: PackedFloat32Array,
	from: int,
	slot: int,
	masks: PackedByteArray,
	rng: RandomNumberGenerator
) -> void:
	var target := slot * _nvec.size()
	var allowed := slot * num_logits if not masks.is_empty() else -1
	var logit := from
	for n: int in _nvec:
		if rng == null:
			discrete[target] = _best(outputs, logit, n, masks, allowed)
		else:
			discrete[target] = _draw(outputs, logit, n, masks, allowed, rng)
		target += 1
		logit += n
		if allowed >= 0:
			allowed += n
	_choose_numbers(outputs, logit, slot, rng)


## What was chosen for one slot, and how probable that was: [code]choices[/code],
## [code]numbers[/code], the [code]probabilities[/code] of all alternatives, and
## [code]means[/code] and [code]deviations[/code] of the numbers, within their bounds. Arguments as
## of [method choose]. A deviation is half of the way between what lies one deviation below the mean
## and one above.
func describe(
	outputs: PackedFloat32Array, from: int, slot: int, masks: PackedByteArray
) -> Dictionary:
	var size := _low.size()
	var means: PackedFloat32Array = []
	var deviations: PackedFloat32Array = []
	for i: int in size:
		var at := from + num_logits + i
		var deviation := _deviation(outputs, at + size, i)
		means.append(_stretch(outputs[at], i))
		var spread := _stretch(outputs[at] + deviation, i) - _stretch(outputs[at] - deviation, i)
		deviations.append(spread / 2.0)
	return {
		"choices": discrete.slice(slot * _nvec.size(), (slot + 1) * _nvec.size()),
		"numbers": continuous.slice(slot * size, (slot + 1) * size),
		"probabilities": _probabilities(outputs, from, slot, masks),
		"means": means,
		"deviations": deviations,
	}


## The softmax of the logits of each choice, 0 for what is not allowed.
func _probabilities(
	outputs: PackedFloat32Array, from: int, slot: int, masks: PackedByteArray
) -> PackedFloat32Array:
	var probabilities: PackedFloat32Array = []
	var allowed := slot * num_logits if not masks.is_empty() else -1
	for n: int in _nvec:
		var highest := outputs[from + _best(outputs, from, n, masks, allowed)]
		var total := 0.0
		var weights: PackedFloat32Array = []
		for i: int in n:
			var is_allowed := allowed < 0 or masks[allowed + i] != 0
			weights.append(exp(outputs[from + i] - highest) if is_allowed else 0.0)
			total += weights[i]
		for weight: float in weights:
			probabilities.append(weight / total)
		from += n
		if allowed >= 0:
			allowed += n
	return probabilities


## The largest logit that is allowed; the first of equal ones.
static func _best(
	outputs: PackedFloat32Array, from: int, n: int, masks: PackedByteArray, allowed: int
) -> int:
	var best := 0
	var highest := -INF
	for i: int in n:
		if outputs[from + i] > highest and (allowed < 0 or masks[allowed + i] != 0):
			highest = outputs[from + i]
			best = i
	return best


## A draw from the softmax of the logits that are allowed.
static func _draw(
	outputs: PackedFloat32Array,
	from: int,
	n: int,
	masks: PackedByteArray,
	allowed: int,
	rng: RandomNumberGenerator
) -> int:
	var best := _best(outputs, from, n, masks, allowed)
	var highest := outputs[from + best]
	var total := 0.0
	for i: int in n:
		if allowed < 0 or masks[allowed + i] != 0:
			total += exp(outputs[from + i] - highest)
	var rest := rng.randf() * total
	for i: int in n:
		if allowed < 0 or masks[allowed + i] != 0:
			rest -= exp(outputs[from + i] - highest)
			if rest < 0.0:
				return i
	return best


func _choose_numbers(
	outputs: PackedFloat32Array, from: int, slot: int, rng: RandomNumberGenerator
) -> void:
	var size := _low.size()
	for i: int in size:
		var value := outputs[from + i]
		if rng != null:
			value = rng.randfn(value, _deviation(outputs, from + size + i, i))
		continuous[slot * size + i] = _stretch(value, i)


## Brings what the network means into the bounds of a number.
func _stretch(value: float, i: int) -> float:
	value = tanh(value) if _is_squashed else clampf(value, -1.0, 1.0)
	value = _low[i] + (_high[i] - _low[i]) * (value * 0.5 + 0.5)
	return clampf(value, _low[i], _high[i])


func _deviation(outputs: PackedFloat32Array, index: int, i: int) -> float:
	if not _deviations.is_empty():
		return _deviations[i]
	return exp(clampf(outputs[index], _log_std_low, _log_std_high))
