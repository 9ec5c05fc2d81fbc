extends RefCounted
## Lets a person play while no trainer is there: agents whose target has
## [code]get_manual_action()[/code] take the action that it returns, and start a new episode when
## theirs ends. While it returns null, the person has not chosen yet, and the agent waits. Agents
## with a policy are left to [LudusPolicyPlayer]. Of many worlds, the first one is played.

const LudusRegistry := preload("res://addons/ludus/bridge/registry.gd")

var _tick: int = 0
## Agents that people may play.
var _agents: Array[LudusAgent] = []
var _seen_changes: int = -1
## The action of each agent in its current step.
var _actions: Dictionary[LudusAgent, Variant] = {}


## Plays one tick.
func advance() -> void:
	if _seen_changes != LudusRegistry.num_changes:
		_update_agents()
	for agent: LudusAgent in _agents:
		if agent.target == null:
			_begin(agent)
		elif agent.world.index == 0 and agent.has_manual_action() and agent.world.is_ready:
			_play(agent)
	_tick += 1


func _update_agents() -> void:
	_seen_changes = LudusRegistry.num_changes
	_agents.clear()
	var kept: Dictionary[LudusAgent, Variant] = {}
	for agent: LudusAgent in LudusRegistry.agents:
		if agent.enabled and agent.policy == null:
			_agents.append(agent)
			if _actions.has(agent):
				kept[agent] = _actions[agent]
	_actions = kept


func _begin(agent: LudusAgent) -> void:
	var problem := agent.connect_to_game()
	if not problem.is_empty():
		push_warning("ludus: %s: %s" % [agent.get_path(), problem])
		agent.enabled = false
	elif agent.has_manual_action():
		_restart(agent)


func _play(agent: LudusAgent) -> void:
	if _tick % agent.ticks_per_step == 0:
		var reward: Variant = agent.target.get_reward()
		_actions[agent] = agent.target.get_manual_action()
		agent.episode_steps += int(_actions[agent] != null)
		var view := LudusRegistry.shown_debug_view()
		if view != null:
			view.take_person(agent, _actions[agent], reward)
		var is_cut := agent.max_episode_steps > 0 and agent.episode_steps > agent.max_episode_steps
		if agent.target.is_done() or is_cut:
			_restart(agent)
	elif agent.action_timing == LudusAgent.ActionTiming.ONCE or not _actions.has(agent):
		return
	if _actions[agent] != null:
		agent.target.apply_action(_actions[agent])


func _restart(agent: LudusAgent) -> void:
	agent.episode_steps = 0
	agent.world.begin_episode()
	agent.target.reset()
