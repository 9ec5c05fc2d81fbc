class_name LudusPolicyPlayer, "res://addons/ludus/icons/ludus_policy_player.svg"
extends Node
## Plays all agents that have a [LudusPolicy], while no trainer is there.
##
## The autoload "Ludus" brings one along, as its [code]player[/code]; put one into the scene only in
## a game without the autoload. Decisions and episodes follow the rules of training: an action lasts
## [member LudusAgent.ticks_per_step] ticks; an agent that is done, or cut off, begins anew at once,
## or together with all agents of its world ([member LudusWorld.episode_mode]). An agent that comes
## into a world that is played already is not reset first.

## Emitted when an episode ends. [param agent] is null if it has left the scene.
signal episode_ended(policy_name, agent, episode_return, num_steps)

## The group that [LudusBridge] joins.
const BRIDGE_GROUP_NAME := "ludus_bridges"

var _arguments := LudusArguments.new()
var _groups: Array = []
## Policies from the command line.
var _policies: Dictionary = {}
var _are_policies_loaded: bool = false
var _worlds: Array = []
## The policy that did not fit an agent, by instance id.
var _refused: Dictionary = {}
var _seen_changes: int = -1
var _tick: int = 0


func _init() -> void:
	pause_mode = Node.PAUSE_MODE_STOP
	process_priority = -1073741824


func _physics_process(_delta: float) -> void:
	if not get_tree().has_group(BRIDGE_GROUP_NAME):
		advance()


## Plays one tick, unless the game is paused.
func advance() -> void:
	if not can_process():
		return
	if not _are_policies_loaded:
		_load_policies()
	if _seen_changes != LudusAgent.num_changes():
		_update_roster()
	for group in _groups:
		if _is_due(group):
			group.collect()
		else:
			group.batch.repeat_actions()
	# All are told before any begins anew, which agents of other groups may do together.
	for group in _groups:
		if _is_due(group):
			_tell_of_ends(group)
	for group in _groups:
		if _is_due(group):
			_end_episodes(group)
	for group in _groups:
		if _is_due(group):
			group.act(_tick)
			_report_mistake(group)
	_tick += 1


func _load_policies() -> void:
	_are_policies_loaded = true
	for policy_name in _arguments.policies:
		var policy: LudusPolicy = LudusPolicy.load_file(_arguments.policies[policy_name])
		_policies[policy_name] = policy
		if not policy.get_error().empty():
			_fail("policy %s: %s" % [policy_name, policy.get_error()])


func _is_due(group: LudusPolicyGroup) -> bool:
	return _tick % group.ticks_per_step == 0


func _update_roster() -> void:
	for group in _groups:
		group.batch.drop_leavers()
		for slot in group.batch.agents.size():
			var agent: LudusAgent = group.batch.agents[slot]
			if agent != null and not (agent.enabled and group.accepts(agent)):
				group.leave(slot)
	var known := _worlds
	_worlds = []
	for world in known:
		if is_instance_valid(world):
			_worlds.append(world)
	var newcomers := []
	for node in get_tree().get_nodes_in_group(LudusAgent.GROUP_NAME):
		if node is LudusAgent and _wants_to_play(node):
			newcomers.append(node)
	# Before their episodes begin, which may bring more agents.
	_seen_changes = LudusAgent.num_changes()
	_admit(newcomers)


func _wants_to_play(agent: LudusAgent) -> bool:
	if not agent.enabled or agent.is_queued_for_deletion() or _find_group(agent) != null:
		return false
	if _policies.has(agent.policy_name):
		agent.policy = _policies[agent.policy_name]
		agent.sample_actions = _arguments.sample_actions
	return agent.policy != null and _refused.get(agent.get_instance_id()) != agent.policy


## Agents of a world that is new begin its first episode; others join in as they are.
func _admit(newcomers: Array) -> void:
	var new_worlds := []
	for agent in newcomers:
		var problem: String = agent.connect_to_game()
		if problem.empty():
			problem = agent.policy.incompatibility(agent)
		if not problem.empty():
			_refused[agent.get_instance_id()] = agent.policy
			_fail("agent %s: %s" % [agent.path_in_world(), problem])
			continue
		if not agent.world in _worlds:
			_worlds.append(agent.world)
			new_worlds.append(agent.world)
			agent.world.begin_episode()
			agent.world.emit_signal("episode_started")
		var group := _group_for(agent)
		var slot := group.join(agent)
		if agent.world in new_worlds:
			_begin(group, slot, agent.world.settle_ticks)
		else:
			group.begin(slot, _tick)


func _group_for(agent: LudusAgent) -> LudusPolicyGroup:
	for group in _groups:
		if group.accepts(agent):
			return group
	var made := LudusPolicyGroup.new(agent)
	_groups.append(made)
	return made


func _find_group(agent: LudusAgent) -> LudusPolicyGroup:
	for group in _groups:
		if group.has(agent):
			return group
	return null


## Resets the agent of a slot; it acts once its world has settled.
func _begin(group: LudusPolicyGroup, slot: int, settle_ticks: int) -> void:
	group.batch.agents[slot].target.reset()
	group.begin(slot, _tick + settle_ticks)


func _end_episodes(group: LudusPolicyGroup) -> void:
	for slot in group.batch.final_slots:
		if not is_instance_valid(group.worlds[slot]):
			continue
		var agent: LudusAgent = group.batch.agents[slot]
		var world: LudusWorld = group.worlds[slot]
		if world.episode_mode == LudusWorld.Episode.WORLD:
			if not _is_played(world):
				_begin_world(world)
		elif agent != null and not agent.is_leaving():
			var is_alone := _count_agents(world) == 1
			world.begin_episode()
			if is_alone:
				world.emit_signal("episode_started")
			_begin(group, slot, world.settle_ticks if is_alone else 0)


func _begin_world(world: LudusWorld) -> void:
	world.begin_episode()
	world.emit_signal("episode_started")
	for group in _groups:
		for slot in group.batch.agents.size():
			var agent: LudusAgent = group.batch.agents[slot]
			if agent != null and agent.world == world and not agent.is_leaving():
				_begin(group, slot, world.settle_ticks)


func _is_played(world: LudusWorld) -> bool:
	for group in _groups:
		for slot in group.worlds.size():
			if group.worlds[slot] == world and group.is_playing(slot):
				return true
	return false


func _count_agents(world: LudusWorld) -> int:
	var count := 0
	for group in _groups:
		for agent in group.batch.agents:
			if agent != null and agent.world == world:
				count += 1
	return count


func _tell_of_ends(group: LudusPolicyGroup) -> void:
	for slot in group.batch.final_slots:
		_tell(group, slot)


func _tell(group: LudusPolicyGroup, slot: int) -> void:
	var episode_return := group.episode_return(slot)
	var num_steps := group.batch.episode_steps(slot)
	var policy_name := group.batch.policy_name
	var agent: LudusAgent = group.batch.agents[slot]
	emit_signal("episode_ended", policy_name, agent, episode_return, num_steps)
	if _arguments.has_report:
		var line := {"policy": policy_name, "return": episode_return, "length": num_steps}
		# Not print(): a game may hold that back for a while.
		printerr("ludus-episode ", LudusJson.write(line))


## The agents of a group whose game made a mistake are played no longer.
func _report_mistake(group: LudusPolicyGroup) -> void:
	if not group.warning.empty():
		_fail(group.warning)
		group.warning = ""
	if group.batch.error.empty():
		return
	_fail(group.batch.error)
	group.batch.error = ""
	for slot in group.batch.agents.size():
		var agent: LudusAgent = group.batch.agents[slot]
		if agent != null:
			_refused[agent.get_instance_id()] = agent.policy
			group.leave(slot)


## Nobody else sees the mistakes of policies that were given on the command line.
func _fail(message: String) -> void:
	push_error("ludus: " + message)
	if not _policies.empty():
		get_tree().quit(1)
