extends LudusSimulation
## A simulation of two agents that writes down what it is told.

## What happened, in order.
var told: Array = []
## Ticks that creation and the beginning of an episode await.
var ticks_to_create: int = 0
var ticks_to_begin: int = 0
## Agents whose episode has ended.
var done: Array = [false, false]
## What a person wants both agents to do; null: nobody plays.
var wish = null


func policy_names() -> PoolStringArray:
	return PoolStringArray(["hero", "target"])


func observation_entries(_policy_name: String) -> Array:
	return [LudusObservationEntry.create("observation", PoolIntArray([2]))]


func action_components(_policy_name: String) -> Array:
	return [LudusActionComponent.discrete("move", 5)]


func max_episode_steps() -> int:
	return 9


func create() -> void:
	told.append("create")
	var _draw := world.rng.randf()
	for _i in ticks_to_create:
		yield(self, "ticked")


func begin_episode() -> void:
	told.append("begin")
	done = [false, false]
	for _i in ticks_to_begin:
		yield(self, "ticked")
	told.append("%.6f" % world.rng.randf())


func begin_agent_episode(agent: int) -> void:
	told.append("begin %d" % agent)
	done[agent] = false


func apply_action(agent: int, action) -> void:
	told.append("%d does %s" % [agent, action])


func advance() -> void:
	told.append("advance")


func get_observation(agent: int):
	return PoolRealArray([agent, told.size()])


func get_reward(agent: int) -> float:
	return agent + 0.5


func is_done(agent: int) -> bool:
	return done[agent]


func get_manual_action(_agent: int):
	return wish
