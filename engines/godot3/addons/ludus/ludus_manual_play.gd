class_name LudusManualPlay
extends Reference
## Lets a person play while no trainer is there: agents whose target has
## [code]get_manual_action()[/code] act on it. Episodes follow the rules of training, as with
## [LudusPolicyPlayer], to which agents with a policy are left. Of many worlds the first one is
## played.

var _tree: SceneTree
var _tick: int = 0
## The action of each agent in its current step.
var _actions: Dictionary = {}
## Agents that people play, and [member LudusWorld.num_beginnings] when their episodes began.
var _begun_at: Dictionary = {}
## Those of them whose episode has ended.
var _ended: Dictionary = {}


func _init(tree: SceneTree) -> void:
	_tree = tree


## Plays one tick.
func advance() -> void:
	var agents := _find_agents()
	var due := []
	for agent in agents:
		if _is_due(agent):
			due.append(agent)
	_admit(agents)
	for agent in due:
		_collect(agent)
	for agent in due:
		_end_episode(agent)
	for agent in due:
		_actions[agent] = null if _ended.has(agent) else _decide(agent)
	for agent in agents:
		var is_repeated: bool = agent.action_timing == LudusAgent.ActionTiming.EVERY_TICK
		if _actions.get(agent) != null and (is_repeated or agent in due):
			agent.target.apply_action(_actions[agent])
	_tick += 1


## Returns the agents that people may play, and forgets all others.
func _find_agents() -> Array:
	var agents := []
	for agent in _tree.get_nodes_in_group(LudusAgent.GROUP_NAME):
		if agent is LudusAgent and agent.enabled and agent.policy == null:
			agents.append(agent)
	for of_agents in [_actions, _begun_at, _ended]:
		for agent in of_agents.keys():
			if not agent in agents:
				of_agents.erase(agent)
	return agents


func _is_due(agent: LudusAgent) -> bool:
	return (
		agent.target != null
		and agent.world.index == 0
		and agent.has_manual_action()
		and _tick % agent.ticks_per_step == 0
		and not agent.is_leaving()
	)


## Agents of a world that is new begin its first episode; others join in as they are.
func _admit(agents: Array) -> void:
	var old_worlds := []
	for agent in _begun_at:
		old_worlds.append(agent.world)
	var new_worlds := []
	for agent in agents:
		if agent.target != null:
			continue
		var problem: String = agent.connect_to_game()
		if not problem.empty():
			push_warning("ludus: %s: %s" % [agent.get_path(), problem])
			agent.enabled = false
		elif agent.has_manual_action():
			if not agent.world in old_worlds + new_worlds:
				new_worlds.append(agent.world)
				if _players_of(agent.world).empty():
					agent.world.begin_episode()
					agent.world.emit_signal("episode_started")
			_begun_at[agent] = agent.world.num_beginnings
			if agent.world in new_worlds:
				_reset(agent)


## Takes in what the last step brought.
func _collect(agent: LudusAgent) -> void:
	if not _begun_at.has(agent):  # a policy has played it
		_begun_at[agent] = agent.world.num_beginnings
	if _ended.has(agent):
		return
	var target := agent.target
	target.get_reward()
	var steps := agent.get_episode_steps()
	var is_cut := agent.max_episode_steps > 0 and steps >= agent.max_episode_steps
	if not is_cut and agent.has_truncation():
		is_cut = target.is_truncated()
	if target.is_done() or is_cut:
		_ended[agent] = true


func _end_episode(agent: LudusAgent) -> void:
	var world := agent.world
	if world.episode_mode == LudusWorld.Episode.WORLD:
		if _begun_at[agent] != world.num_beginnings:  # by the policies that play in it
			_reset(agent)
		elif _ended.has(agent) and _ended.has_all(_players_of(world)):
			_begin_world(world)
	elif _ended.has(agent):
		world.begin_episode()
		if _players_of(world).size() == 1:
			world.emit_signal("episode_started")
		_reset(agent)


func _begin_world(world: LudusWorld) -> void:
	world.begin_episode()
	world.emit_signal("episode_started")
	for agent in _players_of(world):
		_reset(agent)


## Agents of a world that people or policies play.
func _players_of(world: LudusWorld) -> Array:
	var players := []
	for agent in _tree.get_nodes_in_group(LudusAgent.GROUP_NAME):
		if not agent is LudusAgent or agent.world != world:
			continue
		if agent.is_in_batch() if agent.policy != null else _begun_at.has(agent):
			players.append(agent)
	return players


## Returns what the person chooses.
func _decide(agent: LudusAgent):
	agent.set_episode_steps(agent.get_episode_steps() + 1)
	return agent.target.get_manual_action()


func _reset(agent: LudusAgent) -> void:
	_begun_at[agent] = agent.world.num_beginnings
	_ended.erase(agent)
	agent.set_episode_steps(0)
	agent.target.reset()
