extends LudusSimulation
## A simulation of two agents that writes down what it is told.

## What happened, in order.
var log: PackedStringArray = []
## Ticks that creation and the beginning of an episode await.
var ticks_to_create: int = 0
var ticks_to_begin: int = 0
## Agents whose episode has ended.
var done: Array[bool] = [false, false]
## What a person wants both agents to do; null: nobody plays.
var wish: Variant = null


func policy_names() -> PackedStringArray:
	return ["hero", "target"]


func observation_entries(_policy_name: String) -> Array[LudusObservationEntry]:
	return [LudusObservationEntry.create("observation", [2])]


func action_components(_policy_name: String) -> Array[LudusActionComponent]:
	return [LudusActionComponent.discrete("move", 5)]


func max_episode_steps() -> int:
	return 9


func create() -> void:
	log.append("create")
	world.rng.randf()
	for i: int in ticks_to_create:
		await ticked


func begin_episode() -> void:
	log.append("begin")
	done = [false, false]
	for i: int in ticks_to_begin:
		await ticked
	log.append("%.6f" % world.rng.randf())


func begin_agent_episode(agent: int) -> void:
	log.append("begin %d" % agent)
	done[agent] = false


func apply_action(agent: int, action: Variant) -> void:
	log.append("%d does %s" % [agent, action])


func advance() -> void:
	log.append("advance")


func get_observation(agent: int) -> Variant:
	return PackedFloat32Array([agent, log.size()])


func get_reward(agent: int) -> float:
	return agent + 0.5


func is_done(agent: int) -> bool:
	return done[agent]


func get_manual_action(_agent: int) -> Variant:
	return wish
