extends RefCounted
## All worlds and policies of this process as one thing that is reset and stepped.

const LudusCameras := preload("res://addons/ludus/cameras/cameras.gd")
const LudusPolicyBatch := preload("res://addons/ludus/agent/policy_batch.gd")
const LudusSimulationBatch := preload("res://addons/ludus/simulation/simulation_batch.gd")
const LudusRegistry := preload("res://addons/ludus/bridge/registry.gd")
const LudusScriptReview := preload("res://addons/ludus/agent/script_review.gd")
const LudusStage := preload("res://addons/ludus/world/stage.gd")
const LudusWire := preload("res://addons/ludus/bridge/wire.gd")

## What is wrong with the game, or an empty text. The run fails with it.
var error: String = ""
## The policies, in the order of the spec.
var policies: Array[LudusPolicyBatch] = []
## Physics ticks per decision.
var ticks_per_step: int = 1
## Number of bytes of a [code]STEP[/code].
var action_bytes: int = 0

var _stage: LudusStage
var _slots_per_world: Dictionary[String, int] = {}
var _num_agents_in_world: int = 0
var _seen_changes: int = -1
## Whether each agent's episode ends by itself.
var _is_per_agent: bool = true
## Worlds that were made anew and wait until the engine knows their nodes.
var _fresh_worlds: Array[LudusWorld] = []
## Worlds that have begun an episode in this step and ask for settle ticks.
var _settling: Array[LudusWorld] = []


func _init(stage: LudusStage) -> void:
	_stage = stage


## Builds the worlds and gathers their agents into policies. Returns false and sets [member error]
## if the scene cannot be trained. A limit of 0 steps or ticks leaves the choice to the agents.
func open(max_episode_steps: int, ticks_override: int) -> bool:
	if not _stage.build():
		error = _stage.error
		return false
	var rosters := _rosters()
	if error.is_empty() and rosters.is_empty():
		error = "the scene has no enabled LudusAgent"
	if not error.is_empty():
		return false
	for name: String in rosters:
		var agents: Array[LudusAgent] = rosters[name]
		var worlds := PackedInt32Array()
		for slot: int in agents.size():
			worlds.append(slot / _slots_per_world[name])
		var batch_class: GDScript = (
			LudusSimulationBatch if LudusSimulationBatch.fits(agents) else LudusPolicyBatch
		)
		var policy: LudusPolicyBatch = batch_class.new(name, agents, worlds, max_episode_steps)
		policies.append(policy)
		action_bytes += policy.action_bytes()
		_num_agents_in_world += _slots_per_world[name]
	_is_per_agent = _stage.worlds[0].episode_mode == LudusWorld.Episode.AGENT
	_choose_ticks(ticks_override)
	_gather_errors()
	return error.is_empty()


## Describes worlds and policies for the handshake (PROTOCOL.md §4).
func to_json() -> Dictionary:
	var parts: Array[Dictionary] = []
	for policy: LudusPolicyBatch in policies:
		parts.append(policy.to_json(_slots_per_world[policy.policy_name]))
	var description := {
		"num_worlds": _stage.worlds.size(),
		"layout": "grid" if _stage.layout == LudusWorld.Layout.GRID else "isolated",
		"ticks_per_step": ticks_per_step,
		"tick_rate": float(Engine.physics_ticks_per_second),
		"policies": parts,
	}
	var warnings := _doubts()
	if not warnings.is_empty():
		description["warnings"] = Array(warnings)
	return description


## Begins episodes as a [code]RESET[/code] asks (see [method LudusWire.read_reset]). When all
## worlds get a seed they are made anew.
func reset(request: Dictionary) -> void:
	var actions: PackedByteArray = request["actions"]
	var seeds: PackedInt64Array = request["seeds"]
	_set_parameters(request["parameters"], actions)
	for policy: LudusPolicyBatch in policies:
		policy.clear_outcomes()
	var is_rebuilt := actions.count(LudusWire.ResetAction.SEED) == actions.size()
	if is_rebuilt:
		_rebuild_all()
	for i: int in actions.size():
		if actions[i] == LudusWire.ResetAction.SEED:
			_stage.worlds[i].set_seed(seeds[i])
		if actions[i] != LudusWire.ResetAction.LEAVE and not is_rebuilt:
			_begin_world(i)
	_gather_errors()


## Hands the game the actions of a [code]STEP[/code]. Returns what is wrong with them, or an empty
## text; then the game got none.
func apply_actions(payload: PackedByteArray) -> String:
	var offset := 0
	for policy: LudusPolicyBatch in policies:
		offset = policy.read_actions(payload, offset)
	for policy: LudusPolicyBatch in policies:
		var problem := policy.find_wrong_choice()
		if not problem.is_empty():
			return problem
	for policy: LudusPolicyBatch in policies:
		policy.hand_out_actions()
	return ""


## Hands the game the actions of the current step again.
func repeat_actions() -> void:
	_drop_leavers()
	for policy: LudusPolicyBatch in policies:
		policy.repeat_actions()


## Plays one step with random actions, see [method LudusPolicyBatch.play_randomly].
func play_randomly(rng: RandomNumberGenerator) -> void:
	_drop_leavers()
	for policy: LudusPolicyBatch in policies:
		policy.play_randomly(rng)


## Takes in what the last step brought and begins the next episode where one ended.
func collect() -> void:
	_drop_leavers()
	for policy: LudusPolicyBatch in policies:
		policy.collect_outcomes()
	if not LudusRegistry.newcomers.is_empty():
		_admit_newcomers()
	var ended: Dictionary[int, bool] = {}
	for policy: LudusPolicyBatch in policies:
		for slot: int in policy.final_slots:
			_continue_after(policy, slot, ended)
	for i: int in ended:
		_begin_world(i)
	_gather_errors()


## Whether worlds were made anew, so that one frame must pass, with everything paused, before
## their nodes are part of the engine's loop; or cameras must wait so long for what episodes that
## have begun look like.
func is_held() -> bool:
	return not _fresh_worlds.is_empty() or LudusCameras.take_beginnings()


## Begins the episodes of the worlds that were made anew.
func release() -> void:
	var fresh := _fresh_worlds
	_fresh_worlds = []
	for world: LudusWorld in fresh:
		_begin_episode(_stage.find(world))


## Takes the worlds that must tick alone before they are observed.
func take_settling() -> Array[LudusWorld]:
	var settling := _settling
	_settling = []
	return settling


## Appends observations and outcomes of all policies (PROTOCOL.md §7).
func append_to(frame: PackedByteArray) -> void:
	for policy: LudusPolicyBatch in policies:
		policy.append_to(frame)
	for policy: LudusPolicyBatch in policies:
		policy.append_final_to(frame)
	_gather_errors()


## The world that a [code]CALL[/code] names, or null.
func find_world(target: Dictionary) -> LudusWorld:
	var i := int(target.get("world", -1))
	return _stage.worlds[i] if i >= 0 and i < _stage.worlds.size() else null


## The worlds that share the physics space of [param world].
func neighbours_of(world: LudusWorld) -> Array[LudusWorld]:
	var neighbours: Array[LudusWorld] = []
	if _stage.layout == LudusWorld.Layout.GRID:
		neighbours.assign(_stage.worlds)
		neighbours.erase(world)
	return neighbours


## What a [code]CALL[/code] is meant for, or null.
func find_target(target: Dictionary) -> Object:
	var world := find_world(target)
	if world == null:
		return null
	var root := world.root
	if not target.has("agent") or target["agent"] == null:
		var host := root as LudusSimulationHost
		return root if host == null else host.simulation
	var agent := root.get_node_or_null(NodePath(str(target["agent"]))) as LudusAgent
	return agent.target if agent != null else null


## All agents of all worlds by policy, in slot order; null for spare slots.
func _rosters() -> Dictionary:
	var rosters := {}
	LudusRegistry.newcomers.clear()
	for i: int in _stage.worlds.size():
		var world := _stage.worlds[i]
		var by_policy := _agents_of(world)
		if i == 0:
			for name: String in by_policy:
				rosters[name] = [] as Array[LudusAgent]
				_slots_per_world[name] = len(by_policy[name])
		for name: String in rosters:
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
	if world.root is LudusSimulationHost and error.is_empty():
		error = (world.root as LudusSimulationHost).error
	for node: Node in world.root.find_children("*", "Node", true, false) + [world.root]:
		var agent := node as LudusAgent
		if agent == null or not agent.enabled:
			continue
		var problem := agent.connect_to_game()
		if not problem.is_empty():
			error = "agent %s: %s" % [agent.path_in_world(), problem]
			return {}
		var members: Array = by_policy.get_or_add(agent.policy_name, [])
		members.append(agent)
	for name: String in world.spare_slots:
		if by_policy.has(name):
			for i: int in world.spare_slots[name]:
				by_policy[name].append(null)
	return by_policy


## What is probably wrong with the game's scripts; the trainer passes it on.
func _doubts() -> PackedStringArray:
	var found := LudusScriptReview.scene_changes(_stage.worlds[0].root)
	for policy: LudusPolicyBatch in policies:
		if policy.agents[0] != null:
			for doubt: String in policy.agents[0].doubts():
				if doubt not in found:
					found.append(doubt)
	return found


func _choose_ticks(ticks_override: int) -> void:
	ticks_per_step = ticks_override
	for policy: LudusPolicyBatch in policies:
		for agent: LudusAgent in policy.agents:
			if agent == null or ticks_override > 0:
				continue
			if ticks_per_step == 0:
				ticks_per_step = agent.ticks_per_step
			elif ticks_per_step != agent.ticks_per_step:
				error = (
					"agent %s has ticks_per_step %d, another agent has %d: they must agree"
					% [agent.path_in_world(), agent.ticks_per_step, ticks_per_step]
				)


func _set_parameters(parameters: Variant, actions: PackedByteArray) -> void:
	for i: int in actions.size():
		var own: Variant = parameters[i] if parameters is Array else parameters
		if actions[i] != LudusWire.ResetAction.LEAVE and own != null:
			_stage.worlds[i].parameters = (own as Dictionary).duplicate(true)


func _rebuild_all() -> void:
	_stage.build()
	var rosters := _rosters()
	for policy: LudusPolicyBatch in policies:
		if (
			not rosters.has(policy.policy_name)
			or not policy.replace_agents(rosters[policy.policy_name])
		):
			error = "the scene came back with other agents than it had at the start"
			return
	_fresh_worlds = _stage.worlds.duplicate()


## An agent's own next episode, or the next episode of its world once all have ended. A newcomer
## that has taken the slot in the same step goes on as it is, like any other newcomer.
func _continue_after(policy: LudusPolicyBatch, slot: int, ended: Dictionary[int, bool]) -> void:
	if policy.active[slot] == 1:
		return
	var agent := policy.agents[slot]
	if agent != null and _is_per_agent and not agent.is_leaving():
		var world := agent.world
		world.begin_episode()
		if _num_agents_in_world == 1:
			world.episode_started.emit()
			if world.settle_ticks > 0 or not world.is_ready:
				_settling.append(world)
		agent.target.reset()
		policy.activate(slot)
		return
	var i := slot / _slots_per_world[policy.policy_name]
	if not ended.has(i) and not _has_active(i):
		ended[i] = true


func _has_active(i: int) -> bool:
	for policy: LudusPolicyBatch in policies:
		var num_slots := _slots_per_world[policy.policy_name]
		for slot: int in range(i * num_slots, (i + 1) * num_slots):
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
	var spare := _stage.worlds[i].spare_slots
	for policy: LudusPolicyBatch in policies:
		var num_slots := _slots_per_world[policy.policy_name]
		var num_own: int = num_slots - spare.get(policy.policy_name, 0)
		for slot: int in range(i * num_slots, (i + 1) * num_slots):
			var agent := policy.agents[slot]
			var is_gone := agent == null or agent.is_leaving()
			if (slot - i * num_slots < num_own) == is_gone:
				return false
	return true


func _replace_world(i: int) -> void:
	var world := _stage.rebuild_world(i)
	var by_policy := _agents_of(world)
	for policy: LudusPolicyBatch in policies:
		var num_slots := _slots_per_world[policy.policy_name]
		var members: Array = by_policy.get(policy.policy_name, [])
		if members.size() != num_slots:
			error = "world %d came back with other agents than it had at the start" % i
			return
		for k: int in num_slots:
			policy.set_agent(i * num_slots + k, members[k])
	_fresh_worlds.append(world)


func _begin_episode(i: int) -> void:
	var world := _stage.worlds[i]
	world.begin_episode()
	world.episode_started.emit()
	for policy: LudusPolicyBatch in policies:
		var num_slots := _slots_per_world[policy.policy_name]
		for slot: int in range(i * num_slots, (i + 1) * num_slots):
			if policy.agents[slot] != null:
				policy.agents[slot].target.reset()
				policy.activate(slot)
	if world.settle_ticks > 0 or not world.is_ready:
		_settling.append(world)


func _drop_leavers() -> void:
	if _seen_changes == LudusRegistry.num_changes:
		return
	_seen_changes = LudusRegistry.num_changes
	for policy: LudusPolicyBatch in policies:
		policy.drop_leavers()


## Gives newcomers a slot. Those that find none wait for one that becomes free.
func _admit_newcomers() -> void:
	for agent: LudusAgent in LudusRegistry.newcomers.keys():
		var i := _stage.find(LudusWorld.find_above(agent))
		if i < 0 or not agent.enabled or agent.is_in_batch():
			LudusRegistry.newcomers.erase(agent)
		else:
			_admit(agent, i)


func _admit(agent: LudusAgent, i: int) -> void:
	var is_first_try := LudusRegistry.newcomers[agent]
	# To connect reads the game's script: too slow for every step in which an agent waits.
	var problem := agent.connect_to_game() if is_first_try else ""
	if not problem.is_empty():
		LudusRegistry.newcomers.erase(agent)
		error = "agent %s: %s" % [agent.path_in_world(), problem]
		return
	if _take_slot(agent, i) or not is_first_try:
		return
	LudusRegistry.newcomers[agent] = false
	push_warning(
		(
			"ludus: no free slot for agent %s of policy %s; raise LudusWorld.spare_slots"
			% [agent.path_in_world(), agent.policy_name]
		)
	)


## Returns false if no slot of world [param i] is free.
func _take_slot(agent: LudusAgent, i: int) -> bool:
	for policy: LudusPolicyBatch in policies:
		if policy.policy_name != agent.policy_name:
			continue
		var num_slots := _slots_per_world[policy.policy_name]
		for slot: int in range(i * num_slots, (i + 1) * num_slots):
			if policy.agents[slot] == null and policy.active[slot] == 0:
				policy.set_agent(slot, agent)
				policy.activate(slot)
				return true
	return false


func _gather_errors() -> void:
	for policy: LudusPolicyBatch in policies:
		if error.is_empty():
			error = policy.error
