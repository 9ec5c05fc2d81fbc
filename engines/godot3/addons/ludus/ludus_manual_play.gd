class_name LudusManualPlay
extends Reference
## Lets a person play while no trainer is there: agents whose target has
## [code]get_manual_action()[/code] act on it, and begin anew when they are done. Agents with a
## policy are left to [LudusPolicyPlayer]. Of many worlds the first one is played.

var _tree: SceneTree
var _tick: int = 0
## The action of each agent in its current step.
var _actions: Dictionary = {}


func _init(tree: SceneTree) -> void:
	_tree = tree


## Plays one tick.
func advance() -> void:
	for agent in _tree.get_nodes_in_group(LudusAgent.GROUP_NAME):
		if not agent is LudusAgent or not agent.enabled or agent.policy != null:
			continue
		if agent.target == null:
			_begin(agent)
		elif agent.world.index == 0 and agent.has_manual_action():
			_play(agent)
	_tick += 1


func _begin(agent: LudusAgent) -> void:
	var problem := agent.connect_to_game()
	if not problem.empty():
		push_warning("ludus: %s: %s" % [agent.get_path(), problem])
		agent.enabled = false
	elif agent.has_manual_action():
		_restart(agent)


func _play(agent: LudusAgent) -> void:
	var target := agent.target
	if _tick % agent.ticks_per_step == 0:
		var steps := agent.get_episode_steps() + 1
		agent.set_episode_steps(steps)
		target.get_reward()
		_actions[agent] = target.get_manual_action()
		var is_cut := agent.max_episode_steps > 0 and steps > agent.max_episode_steps
		if target.is_done() or is_cut:
			_restart(agent)
	elif agent.action_timing == LudusAgent.ActionTiming.ONCE or not _actions.has(agent):
		return
	if _actions[agent] != null:
		target.apply_action(_actions[agent])


func _restart(agent: LudusAgent) -> void:
	agent.set_episode_steps(0)
	agent.world.begin_episode()
	agent.target.reset()
