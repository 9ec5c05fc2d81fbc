extends RefCounted
## One agent of a [LudusSimulation], with the methods that a [LudusAgent] asks of its target.

## The simulation.
var simulation: LudusSimulation
## Number of the agent in the simulation.
var index: int
## Whether the agent waits: for the episode to begin, or, when it has ended, for the others.
var is_idle: bool = true
## Whether something plays the agent.
var is_played: bool = false

var _host: LudusSimulationHost


func _init(host: LudusSimulationHost, agent: int) -> void:
	_host = host
	simulation = host.simulation
	index = agent


## Begins the agent's next episode, or the world's.
func reset() -> void:
	_host.begin_agent(self)


## Hands the action to the simulation.
func apply_action(action: Variant) -> void:
	is_played = true
	if not is_idle:
		simulation.apply_action(index, action)


## What the agent sees.
func get_observation() -> Variant:
	return simulation.get_observation(index)


## The agent's reward since the last call.
func get_reward() -> float:
	return 0.0 if is_idle else simulation.get_reward(index)


## Whether the agent's episode has ended.
func is_done() -> bool:
	return not is_idle and simulation.is_done(index)


## Whether the agent's episode is cut off.
func is_truncated() -> bool:
	return not is_idle and simulation.is_truncated(index)


## What the agent may choose.
func get_action_mask() -> PackedByteArray:
	return simulation.get_action_mask(index)


## What a person wants the agent to do, or null.
func get_manual_action() -> Variant:
	return null if is_idle else simulation.get_manual_action(index)
