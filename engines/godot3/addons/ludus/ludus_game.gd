class_name LudusGame
extends Reference
## All worlds and policies of this process as one thing that is reset and stepped.

## What is wrong with the game, or an empty text. The run fails with it.
var error: String = ""
## The policies ([LudusPolicyBatch]), in the order of the spec.
var policies: Array = []
## Physics ticks per decision.
var ticks_per_step: int = 1
## Number of bytes of a [code]STEP[/code].
var action_bytes: int = 0

var _stage: LudusStage
var _slots_per_world: Dictionary = {}
var _num_agents_in_world: int = 0
## Whether each agent's episode ends by itself.
var _is_per_agent: bool = true
## Worlds that were made anew and wait until the engine knows their nodes.
var _fresh_worlds: Array = []
## Worlds that have begun an episode in this step and ask for settle ticks.
var _settling: Array = []


func _init(stage: LudusStage) -> void:
	_stage = stage


## Builds the worlds and gathers their agents into policies. Returns false and sets [member error]
## if the scene cannot be trained. A limit of 0 steps or ticks leaves the choice to the agents.
func open(max_episode_steps: int, ticks_override: int) -> bool:
	if not _stage.build():
		error = _stage.error
		return false
	var rosters := _rosters()
	if error.empty() and rosters.empty():
		error = "the scene has no enabled LudusAgent"
	if not error.empty():
		return false
	for name in rosters:
		var worlds := PoolIntArray()
		for slot in rosters[name].size():
			worlds.append(slot / _slots_per_world[name])
		var policy := LudusPolicyBatch.new(name, rosters[name], worlds, max_episode_steps)
		policies.append(policy)
		action_bytes += policy.action_bytes()
		_num_agents_in_world += _slots_per_world[name]
	for policy in policies:
		# Cameras are drawn together, once a step.
		policy.are_alone = _num_agents_in_world == 1 and not LudusCameras.are_used()
	_is_per_agent = _stage.worlds[0].episode_mode == LudusWorld.Episode.AGENT
	_choose_ticks(ticks_override)
	_gather_errors()
	return error.empty()


## Describes worlds and policies for the handshake (PROTOCOL.md §4).
func to_json() -> Dictionary:
	var parts := []
	for policy in policies:
		parts.append(policy.to_json(_slots_per_world[policy.policy_name]))
	return {
		"num_worlds": _stage.worlds.size(),
		"layout": "grid" if _stage.layout == LudusWorld.Layout.GRID else "isolated",
		"ticks_per_step": ticks_per_step,
		"tick_rate": float(Engine.iterations_per_second),
		"policies": parts,
	}


## Begins episodes as a [code]RESET[/code] asks (see [method LudusWire.read_reset]). When all
## worlds get a seed they are made anew.
func reset(request: Dictionary) -> void:
	var actions: Array = request["actions"]
	var seeds: Array = request["seeds"]
	_set_parameters(request["parameters"], actions)
	for policy in policies:
		policy.clear_outcomes()
	var is_rebuilt := actions.count(LudusWire.ResetAction.SEED) == actions.size()
	if is_rebuilt:
		_rebuild_all()
	for i in actions.size():
		if actions[i] == LudusWire.ResetAction.SEED:
			_stage.worlds[i].set_seed(seeds[i])
		if actions[i] != LudusWire.ResetAction.LEAVE and not is_rebuilt:
			_begin_world(i)
	_gather_errors()


## Hands the game the actions of a [code]STEP[/code]. Returns what is wrong with them, or an empty
## text; then the game got none.
func apply_actions(payload: PoolByteArray) -> String:
	var offset := 0
	for policy in policies:
		offset = policy.read_actions(payload, offset)
	for policy in policies:
		var problem: String = policy.find_wrong_choice()
		if not problem.empty():
			return problem
	for policy in policies:
		policy.hand_out_actions()
	return ""


## Hands the game the actions of the current step again.
func repeat_actions() -> void:
	_drop_leavers()
	for policy in policies:
		policy.repeat_actions()


## Plays one step with random actions, see [method LudusPolicyBatch.play_randomly].
func play_randomly(rng: RandomNumberGenerator) -> void:
	_drop_leavers()
	for policy in policies:
		policy.play_randomly(rng)


## Takes in what the last step brought and begins the next episode where one ended.
func collect() -> void:
	_drop_leavers()
	for policy in policies:
		policy.collect_outcomes()
	if LudusWorld.take_change(LudusWorld.NEWCOMERS):
		_admit_newcomers()
	var ended := []
	for policy in policies:
		for slot in policy.final_slots:
			_continue_after(policy, slot, ended)
	for i in ended:
		_begin_world(i)
	_gather_errors()


## Whether worlds were made anew, so that one frame must pass, with everything paused, before
## their nodes are part of the engine's loop; or cameras must wait so long for what episodes that
## have begun look like.
func is_held() -> bool:
	return not _fresh_worlds.empty() or LudusCameras.take_beginnings()


## Prepares the worlds that were made anew for that frame.
func hold() -> void:
	_stage.warm_up(_fresh_worlds)


## Begins the episodes of the worlds that were made anew.
func release() -> void:
	_stage.end_warm_up()
	var fresh := _fresh_worlds
	_fresh_worlds = []
	for world in fresh:
		_begin_episode(_stage.worlds.find(world))


## Takes the worlds that must tick alone before they are observed.
func take_settling() -> Array:
	var settling := _settling
	_settling = []
	return settling


## Observations and outcomes of all policies (PROTOCOL.md §7).
func to_bytes() -> PoolByteArray:
	var bytes := PoolByteArray()
	for policy in policies:
		bytes.append_array(policy.to_bytes())
	for policy in policies:
		bytes.append_array(policy.final_to_bytes())
	_gather_errors()
	return bytes


## What a [code]CALL[/code] is meant for, or null.
func find_target(target: Dictionary) -> Object:
	var i := int(target.get("world", -1))
	if i < 0 or i >= _stage.worlds.size():
		return null
	var root: Node = _stage.worlds[i].root
	if target.get("agent") == null:
		return root
	var agent := root.get_node_or_null(NodePath(str(target["agent"]))) as LudusAgent
	return agent.target if agent != null else null


## All agents of all worlds by policy, in slot order; null for spare slots.
func _rosters() -> Dictionary:
	var rosters := {}
	var _had_newcomers := LudusWorld.take_change(LudusWorld.NEWCOMERS)
	for i in _stage.worlds.size():
		var world: LudusWorld = _stage.worlds[i]
		world.newcomers.clear()
		var by_policy := _agents_of(world)
		if i == 0:
			for name in by_policy:
				rosters[name] = []
				_slots_per_world[name] = by_policy[name].size()
		for name in rosters:
			var members: Array = by_policy.get(name, [])
			if members.size() != _slots_per_world[name]:
				error = (
					"world %d has %d agents of policy %s, world 0 has %d"
					% [i, members.size(), name, _slots_per_world[name]]
				)
				return {}
			rosters[name].append_array(members)
	return rosters


func _agents_of(world: LudusWorld) -> Dictionary:
	var by_policy := {}
	for node in _nodes_under(world.root) + [world.root]:
		var agent := node as LudusAgent
		if agent == null or not agent.enabled:
			continue
		var problem := agent.connect_to_game()
		if not problem.empty():
			error = "agent %s: %s" % [agent.path_in_world(), problem]
			return {}
		if not by_policy.has(agent.policy_name):
			by_policy[agent.policy_name] = []
		by_policy[agent.policy_name].append(agent)
	for name in world.spare_slots:
		if by_policy.has(name):
			for _i in world.spare_slots[name]:
				by_policy[name].append(null)
	return by_policy


func _nodes_under(node: Node) -> Array:
	var nodes := []
	for child in node.get_children():
		nodes.append(child)
		nodes.append_array(_nodes_under(child))
	return nodes


func _choose_ticks(ticks_override: int) -> void:
	ticks_per_step = ticks_override
	for policy in policies:
		for agent in policy.agents:
			if agent == null or ticks_override > 0:
				continue
			if ticks_per_step == 0:
				ticks_per_step = agent.ticks_per_step
			elif ticks_per_step != agent.ticks_per_step:
				error = (
					"agent %s has ticks_per_step %d, another agent has %d: they must agree"
					% [agent.path_in_world(), agent.ticks_per_step, ticks_per_step]
				)


func _set_parameters(parameters, actions: Array) -> void:
	for i in actions.size():
		var own = parameters[i] if parameters is Array else parameters
		if actions[i] != LudusWire.ResetAction.LEAVE and own != null:
			_stage.worlds[i].parameters = own.duplicate(true)


func _rebuild_all() -> void:
	if not _stage.build():
		error = _stage.error
		return
	var rosters := _rosters()
	for policy in policies:
		if (
			not rosters.has(policy.policy_name)
			or not policy.replace_agents(rosters[policy.policy_name])
		):
			error = "the scene came back with other agents than it had at the start"
			return
	_fresh_worlds = _stage.worlds.duplicate()


## An agent's own next episode, or the next episode of its world once all have ended. A newcomer
## that has taken the slot in the same step goes on as it is, like any other newcomer.
func _continue_after(policy: LudusPolicyBatch, slot: int, ended: Array) -> void:
	if policy.active[slot] == 1:
		return
	var agent: LudusAgent = policy.agents[slot]
	if agent != null and _is_per_agent and not agent.is_leaving():
		var world := agent.world
		world.begin_episode()
		if _num_agents_in_world == 1:
			world.emit_signal("episode_started")
			if world.settle_ticks > 0:
				_settling.append(world)
		agent.target.reset()
		policy.activate(slot)
		return
	var i: int = slot / _slots_per_world[policy.policy_name]
	if not _has_active(i) and not i in ended:
		ended.append(i)


func _has_active(i: int) -> bool:
	for policy in policies:
		var num_slots: int = _slots_per_world[policy.policy_name]
		for slot in range(i * num_slots, (i + 1) * num_slots):
			if policy.active[slot] == 1:
				return true
	return false


## Begins a world's next episode; a world whose agents have left the scene is made anew first.
func _begin_world(i: int) -> void:
	if not _is_complete(i):
		_replace_world(i)
	else:
		_begin_episode(i)


func _is_complete(i: int) -> bool:
	var spare: Dictionary = _stage.worlds[i].spare_slots
	for policy in policies:
		var num_slots: int = _slots_per_world[policy.policy_name]
		var num_own: int = num_slots - spare.get(policy.policy_name, 0)
		for slot in range(i * num_slots, (i + 1) * num_slots):
			var agent: LudusAgent = policy.agents[slot]
			var is_gone := agent == null or agent.is_leaving()
			if (slot - i * num_slots < num_own) == is_gone:
				return false
	return true


func _replace_world(i: int) -> void:
	var world := _stage.rebuild_world(i)
	world.newcomers.clear()
	var by_policy := _agents_of(world)
	for policy in policies:
		var num_slots: int = _slots_per_world[policy.policy_name]
		var members: Array = by_policy.get(policy.policy_name, [])
		if members.size() != num_slots:
			error = "world %d came back with other agents than it had at the start" % i
			return
		for k in num_slots:
			policy.set_agent(i * num_slots + k, members[k])
	_fresh_worlds.append(world)


func _begin_episode(i: int) -> void:
	var world: LudusWorld = _stage.worlds[i]
	world.begin_episode()
	world.emit_signal("episode_started")
	for policy in policies:
		var num_slots: int = _slots_per_world[policy.policy_name]
		for slot in range(i * num_slots, (i + 1) * num_slots):
			if policy.agents[slot] != null:
				policy.agents[slot].target.reset()
				policy.activate(slot)
	if world.settle_ticks > 0:
		_settling.append(world)


func _drop_leavers() -> void:
	if LudusWorld.take_change(LudusWorld.LEAVERS):
		for policy in policies:
			policy.drop_leavers()


## Gives newcomers a slot. Those that find none wait for one that becomes free.
func _admit_newcomers() -> void:
	for i in _stage.worlds.size():
		var newcomers: Dictionary = _stage.worlds[i].newcomers
		for agent in newcomers.keys():
			if not is_instance_valid(agent) or not agent.enabled or _has_slot(agent):
				var _was_there := newcomers.erase(agent)
			else:
				_admit(agent, i)
		if not newcomers.empty():
			LudusWorld.announce(LudusWorld.NEWCOMERS)


func _has_slot(agent: LudusAgent) -> bool:
	for policy in policies:
		if policy.agents.has(agent):
			return true
	return false


func _admit(agent: LudusAgent, i: int) -> void:
	var newcomers: Dictionary = _stage.worlds[i].newcomers
	var is_first_try: bool = newcomers[agent]
	var problem := agent.connect_to_game() if is_first_try else ""
	if not problem.empty():
		error = "agent %s: %s" % [agent.path_in_world(), problem]
	if not problem.empty() or _take_slot(agent, i):
		var _was_there := newcomers.erase(agent)
	elif is_first_try:
		newcomers[agent] = false
		push_warning(
			(
				"ludus: no free slot for agent %s of policy %s; raise LudusWorld.spare_slots"
				% [agent.path_in_world(), agent.policy_name]
			)
		)


## Returns false if no slot of world [param i] is free.
func _take_slot(agent: LudusAgent, i: int) -> bool:
	for policy in policies:
		if policy.policy_name != agent.policy_name:
			continue
		var num_slots: int = _slots_per_world[policy.policy_name]
		for slot in range(i * num_slots, (i + 1) * num_slots):
			if policy.agents[slot] == null and policy.active[slot] == 0:
				policy.set_agent(slot, agent)
				policy.activate(slot)
				return true
	return false


func _gather_errors() -> void:
	for policy in policies:
		if error.empty():
			error = policy.error
