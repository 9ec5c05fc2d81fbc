@tool
extends LudusAgent
## A [LudusAgent] that stands for one agent of a [LudusSimulation]. [LudusSimulationHost] makes it.

const LudusSimulationSeat := preload("res://addons/ludus/simulation/simulation_seat.gd")

## The agent in the simulation.
var seat: LudusSimulationSeat


## Takes what the simulation declares for the agent's policy.
func bind(own_seat: LudusSimulationSeat) -> void:
	seat = own_seat
	var simulation := seat.simulation
	policy_name = simulation.policy_names()[seat.index]
	observation = simulation.observation_entries(policy_name)
	action = simulation.action_components(policy_name)
	settings = simulation.settings(policy_name)
	has_action_mask = simulation.has_action_mask(policy_name)
	ticks_per_step = simulation.ticks_per_step()
	max_episode_steps = simulation.max_episode_steps()


## Finds the world. Returns what is wrong with the simulation, or an empty text.
func connect_to_game() -> String:
	if observation.is_empty():
		return '%s: observation_entries("%s") is empty' % [seat.simulation.describe(), policy_name]
	if action.is_empty():
		return '%s: action_components("%s") is empty' % [seat.simulation.describe(), policy_name]
	return super()


func has_truncation() -> bool:
	return seat.simulation.overrides(&"is_truncated")


func has_manual_action() -> bool:
	return seat.simulation.overrides(&"get_manual_action")


func _find_target() -> Object:
	return seat
