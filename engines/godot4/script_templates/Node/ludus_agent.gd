# meta-name: Ludus: a node with an agent
# meta-description: The methods that a LudusAgent below the node asks for
# meta-default: false

extends _BASE_


## Does what the policy chose, in every tick of a step. One choice comes as int, numbers as
## PackedFloat32Array.
func apply_action(action: int) -> void:
	pass


## What the agent sees. Leave it out where sensors below the node see everything.
func get_observation() -> PackedFloat32Array:
	return PackedFloat32Array([0.0])


## What the last step was worth.
func get_reward() -> float:
	return 0.0


## Whether the episode has ended for good.
func is_done() -> bool:
	return false


## Puts everything back for the next episode, at once: no await, and randomness from the world only.
func reset() -> void:
	var rng := LudusWorld.of(self).rng
