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
@export var name: String = "action"
## A choice, or numbers.
@export var kind: Kind = Kind.DISCRETE
## Number of alternatives of a choice.
@export_range(1, 1048576) var n: int = 2
## Count of numbers.
@export_range(1, 65536) var size: int = 1
## Smallest value of each number.
@export var low: float = -1.0
## Largest value of each number.
@export var high: float = 1.0


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
