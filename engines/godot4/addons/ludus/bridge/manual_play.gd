extends RefCounted
## Lets a person play while no trainer is there: agents whose target has
## [code]get_manual_action()[/code] take the action that it returns. While it returns null, the
## person has not chosen yet, and the agent waits. Episodes follow the rules of training, as with
## [LudusPolicyPlayer], to which agents with a policy are left. Of many worlds, the first one is
## played.

const LudusRegistry := preload("res://addons/ludus/bridge/registry.gd")

var _tick: int = 0
## Agents that people may play.
var _agents: Array[LudusAgent] = []
var _seen_changes: int = -1
## The action of each agent in its current step.
var _actions: Dictionary[LudusAgent, Variant] = {}
## Agents that people play, and [member LudusWorld.num_beginnings] when their episodes began.
var _begun_at: Dictionary[LudusAgent, int] = {}
## Those of them whose episode has ended.
var _ended: Dictionary[LudusAgent, bool] = {}


## Plays one tick.
func advance() -> void:
	if _seen_changes != LudusRegistry.num_changes:
		_update_agents()
	var due: Array[LudusAgent] = _agents.filter(_is_due)
	_admit()
	var rewards: Array[Variant] = due.map(_collect)
	for agent: LudusAgent in due:
		_end_episode(agent)
	for i: int in due.size():
		_decide(due[i], rewards[i])
	for agent: LudusAgent in _agents:
		var is_repeated := agent.action_timing == LudusAgent.ActionTiming.EVERY_TICK
		if _actions.get(agent) != null and (is_repeated or agent in due):
			agent.target.apply_action(_actions[agent])
	_tick += 1


func _update_agents() -> void:
	_seen_changes = LudusRegistry.num_changes
	_agents.clear()
	for agent: LudusAgent in LudusRegistry.agents:
		if agent.enabled and agent.policy == null:
			_agents.append(agent)
	for of_agents: Dictionary in [_actions, _begun_at, _ended]:
		for agent: Variant in of_agents.keys():
			if agent not in _agents:
				of_agents.erase(agent)


func _is_due(agent: LudusAgent) -> bool:
	return (
		agent.target != null
		and agent.world.index == 0
		and agent.has_manual_action()
		and agent.world.is_ready
		and _tick % agent.ticks_per_step == 0
		and not agent.is_leaving()
	)


## Agents of a world that is new begin its first episode; others join in as they are.
func _admit() -> void:
	var new_worlds: Array[LudusWorld] = []
	for agent: LudusAgent in _agents:
		if agent.target != null:
			continue
		var problem := agent.connect_to_game()
		if not problem.is_empty():
			push_warning("ludus: %s: %s" % [agent.get_path(), problem])
			agent.enabled = false
		elif agent.has_manual_action():
			if not _begun_at.keys().any(_is_in_world.bind(agent.world)):
				new_worlds.append(agent.world)
				if _players_of(agent.world).is_empty():
					agent.world.begin_episode()
					agent.world.episode_started.emit()
			_begun_at[agent] = agent.world.num_beginnings
			if agent.world in new_worlds:
				_reset(agent)


## Takes in what the last step brought, and returns its reward.
func _collect(agent: LudusAgent) -> Variant:
	if not _begun_at.has(agent):  # a policy has played it
		_begun_at[agent] = agent.world.num_beginnings
	if _ended.has(agent):
		return null
	var reward: Variant = agent.target.get_reward()
	var is_cut := agent.max_episode_steps > 0 and agent.episode_steps >= agent.max_episode_steps
	if not is_cut and agent.has_truncation():
		is_cut = agent.target.is_truncated()
	if agent.target.is_done() or is_cut:
		_ended[agent] = true
	return reward


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
			world.episode_started.emit()
		_reset(agent)


func _begin_world(world: LudusWorld) -> void:
	world.begin_episode()
	world.episode_started.emit()
	for agent: LudusAgent in _players_of(world):
		_reset(agent)


## Agents of a world that people or policies play.
func _players_of(world: LudusWorld) -> Array[LudusAgent]:
	var players: Array[LudusAgent] = []
	for agent: LudusAgent in LudusRegistry.agents:
		var has_player := agent.is_in_batch() if agent.policy != null else _begun_at.has(agent)
		if has_player and _is_in_world(agent, world):
			players.append(agent)
	return players


func _is_in_world(agent: LudusAgent, world: LudusWorld) -> bool:
	return agent.world == world


func _decide(agent: LudusAgent, reward: Variant) -> void:
	_actions[agent] = null
	if _ended.has(agent) or not agent.world.is_ready:
		return
	_actions[agent] = agent.target.get_manual_action()
	agent.episode_steps += int(_actions[agent] != null)
	var view := LudusRegistry.shown_debug_view()
	if view != null:
		view.take_person(agent, _actions[agent], reward)


func _reset(agent: LudusAgent) -> void:
	_begun_at[agent] = agent.world.num_beginnings
	_ended.erase(agent)
	agent.episode_steps = 0
	agent.target.reset()
