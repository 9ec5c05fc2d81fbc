@tool
@icon("res://addons/ludus/icons/ludus_action_component.svg")
class_name LudusActionComponent
extends Resource
## One named part of an action: a choice among n, or some numbers.

## What the policy decides.
enum Kind {
	DISCRETE,  ## A choice: 0 to n - 1.
	CONTINUOUS,  ## Numbers between low and high.
}

## Key in the dictionary that a mixed action is.
@export var name: String = "action":
	set(value):
		name = value
		emit_changed()
## A choice, or numbers.
@export var kind: LudusActionComponent.Kind = Kind.DISCRETE:
	set(value):
		kind = value
		notify_property_list_changed()
		emit_changed()
## Number of alternatives of a choice.
@export_range(1, 1048576) var n: int = 2:
	set(value):
		n = value
		emit_changed()
## Count of numbers.
@export_range(1, 65536) var size: int = 1:
	set(value):
		size = value
		emit_changed()
## Smallest value of each number.
@export var low: float = -1.0:
	set(value):
		low = value
		emit_changed()
## Largest value of each number.
@export var high: float = 1.0:
	set(value):
		high = value
		emit_changed()


## Makes a choice among [param alternatives] in code.
static func discrete(component_name: String, alternatives: int) -> LudusActionComponent:
	var component := LudusActionComponent.new()
	component.name = component_name
	component.n = alternatives
	return component


## Makes [param count] numbers between [param smallest] and [param largest] in code.
static func continuous(
	component_name: String, count: int = 1, smallest: float = -1.0, largest: float = 1.0
) -> LudusActionComponent:
	var component := LudusActionComponent.new()
	component.name = component_name
	component.kind = Kind.CONTINUOUS
	component.size = count
	component.low = smallest
	component.high = largest
	return component


## Whether n, size and bounds make sense.
func is_valid() -> bool:
	return n >= 1 if kind == Kind.DISCRETE else size >= 1 and low < high


## Describes the component for the handshake (PROTOCOL.md §4).
func to_json() -> Dictionary:
	if kind == Kind.DISCRETE:
		return {"name": name, "kind": "discrete", "n": n}
	return {"name": name, "kind": "continuous", "size": size, "low": low, "high": high}


## Hides what this kind has no use for.
func _validate_property(property: Dictionary) -> void:
	var property_name: StringName = property["name"]
	var hidden: Array[StringName] = [&"n"]
	if kind == Kind.DISCRETE:
		hidden = [&"size", &"low", &"high"]
	if property_name in hidden:
		property["usage"] = PROPERTY_USAGE_NO_EDITOR


## Name, kind and size, for people to read.
func describe() -> String:
	if kind == Kind.DISCRETE:
		return "%s  one of %d" % [name, n]
	return "%s  float32[%d]  %s to %s" % [name, size, String.num(low, 4), String.num(high, 4)]
