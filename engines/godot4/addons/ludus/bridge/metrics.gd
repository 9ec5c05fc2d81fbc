extends RefCounted
## Numbers that the game reports, until the trainer fetches them with its requests
## (PROTOCOL.md §8, "Metrics").

## The capability that both sides must have.
const CAPABILITY := "metrics"
const KIND := "metrics"
const MAX_NAMES := 64
const MAX_NAME_LENGTH := 128
## Characters that names do not have (PROTOCOL.md §1): Unicode's control, format, surrogate,
## private-use and unassigned ones, separators but the space, and a space at either end.
const UNPRINTABLE := r"[\p{C}\p{Zl}\p{Zp}]|(?! )\p{Zs}|^ | $"

## Whether a trainer fetches them.
var is_open: bool = false
## What is wrong with a report, and whose it was; empty as long as nothing is.
var error: String = ""

## By name: count, sum, lowest and highest value.
var _summaries: Dictionary[String, PackedFloat64Array] = {}


## Adds a value. [param reporter] is named if that cannot be.
func add(metric: String, value: float, reporter: Node) -> void:
	if not is_open or not error.is_empty():
		return
	if not is_finite(value):
		_refuse("metric %s is %s, expected a finite number" % [metric, value], reporter)
	elif _summaries.has(metric):
		var summary := _summaries[metric]
		summary[0] += 1.0
		summary[1] += value
		summary[2] = minf(summary[2], value)
		summary[3] = maxf(summary[3], value)
		_summaries[metric] = summary
		if not is_finite(summary[1]):
			_refuse(
				"metric %s adds up to %s, expected a finite number" % [metric, summary[1]], reporter
			)
	elif metric.is_empty() or metric.length() > MAX_NAME_LENGTH:
		_refuse("a metric's name has %d characters, expected 1 to 128" % metric.length(), reporter)
	elif RegEx.create_from_string(UNPRINTABLE).search(metric) != null:
		_refuse(
			(
				'a metric\'s name is "%s", expected only printable characters, no space at either end'
				% metric.c_escape()
			),
			reporter
		)
	elif _summaries.size() == MAX_NAMES:
		_refuse(
			"metric %s is one more than the %d that there may be" % [metric, MAX_NAMES], reporter
		)
	else:
		_summaries[metric] = PackedFloat64Array([1.0, value, value, value])


## Returns what was reported as a request in a list, or an empty list, and forgets it.
func take() -> Array[Dictionary]:
	if _summaries.is_empty():
		return []
	var metrics := {}
	for metric: String in _summaries:
		var summary := _summaries[metric]
		metrics[metric] = {
			"count": summary[0], "sum": summary[1], "min": summary[2], "max": summary[3]
		}
	_summaries.clear()
	return [{"kind": KIND, "metrics": metrics}]


func _refuse(text: String, reporter: Node) -> void:
	error = "%s: %s" % [reporter.get_path() if reporter.is_inside_tree() else reporter.name, text]
