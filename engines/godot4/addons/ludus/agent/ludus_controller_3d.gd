@icon("res://addons/ludus/icons/ludus_agent.svg")
class_name LudusController3D
extends Node3D
## The five methods of an agent in 3D, to be overridden: what it does, sees and gets.
##
## Put the node below the body that it steers, a [LudusAgent] below it, and choose [b]Extend
## Script[/b] in its menu. The editor completes the methods after [code]func[/code]. A method that
## is not overridden counts as missing, as it does in any other script: the first five are needed,
## but [method get_observation] not where [LudusRays3D] or other sensors lie below the node.
## [codeblock]
## extends LudusController3D
##
## @onready var player: CharacterBody3D = get_parent()
##
## func apply_action(action: int) -> void:
##     player.velocity.x = 5.0 if action == 1 else -5.0
##
## func get_reward() -> float:
##     return player.position.x
##
## func is_done() -> bool:
##     return player.position.x > 20.0
##
## func reset() -> void:
##     player.position.x = world.rng.randf_range(-2.0, 2.0)
## [/codeblock]
## A controller is not needed: any node may have the methods.

## The world that the agent is in: [member LudusWorld.rng] is its randomness.
var world: LudusWorld:
	get:
		return LudusWorld.of(self)

## Does what the policy chose. One choice is an [int], several are a [PackedInt64Array], numbers a
## [PackedFloat32Array], and both kinds a dictionary by name. Declare the type that yours has.
@warning_ignore("untyped_declaration")
func apply_action(_action) -> void:
	pass


## What the agent sees: an array of numbers, or a dictionary of entry name to array or [Image].
@warning_ignore("untyped_declaration")
func get_observation():
	return null


## What the last step was worth.
func get_reward() -> float:
	return 0.0


## Whether the episode has ended for good (terminated).
func is_done() -> bool:
	return false


## Puts everything back for the next episode, at once: without [code]await[/code].
func reset() -> void:
	pass


## Optional: whether the episode is cut off, though it has not ended.
func is_truncated() -> bool:
	return false


## Optional: one byte for each alternative of each choice, 1 = allowed.
func get_action_mask() -> PackedByteArray:
	return []


## Optional: what a person wants while no trainer is there, as [method apply_action] takes it; null
## is nothing.
@warning_ignore("untyped_declaration")
func get_manual_action():
	return null
