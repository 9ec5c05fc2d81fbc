class_name AIRunner
extends Node

## Stands for godot-ai's class in tests: plays and trains some rounds over the original wire,
## without keys, then quits. Arguments: port, rounds. Leaves the mean score of each round in
## scores.json.

var env_delegate: AIBaseEnvironment

var _server = AIServerTCP.new()


func _ready():
	add_child(_server)
	var arguments = OS.get_cmdline_user_args()
	await _server.connect_to_server(int(arguments[0]))
	_init_agents()
	var scores = []
	for epoch in range(1, int(arguments[1]) + 1):
		scores.append(await _play_and_train(epoch))
	for agent_name in env_delegate.get_agent_names():
		_server.ask({"command": "write_policy", "file_name": agent_name})
	_server.write_file("scores.json", {"scores": scores})
	get_tree().quit()


func _init_agents():
	for agent_name in env_delegate.get_agent_names():
		(
			_server
			. ask(
				{
					"command": "init",
					"file_name": agent_name,
					"state_dim": env_delegate.get_state_dim(agent_name),
					"action_dim": env_delegate.get_action_dim(agent_name),
					"batchsize": env_delegate.get_batch_size(agent_name),
					"hidden_size": env_delegate.get_hidden_size(agent_name),
					"num_actor_layers": env_delegate.get_num_actor_layers(agent_name),
					"num_critic_layers": env_delegate.get_num_critic_layers(agent_name),
					"replay_capacity": env_delegate.get_replay_capacity(agent_name),
				}
			)
		)
		_server.ask({"command": "load", "file_name": agent_name})


func _play_and_train(epoch: int) -> float:
	env_delegate.update_status(epoch, "playing")
	var sims = []
	for i in range(env_delegate.get_simulation_count()):
		var sim = env_delegate.new_simulation()
		await sim.new_game(get_tree().physics_frame)
		sims.append(sim)
	var deterministic = env_delegate.get_is_deterministic_map(epoch)
	var replays = await _play_round(sims, deterministic)
	(
		_server
		. ask(
			{
				"command": "submit_batch_replay",
				"path": _server.write_file("batch_replays.json", {"replays": replays}),
			}
		)
	)
	for agent_name in env_delegate.get_agent_names():
		if !deterministic[agent_name]:
			(
				_server
				. ask(
					{
						"command": "train",
						"file_name": agent_name,
						"steps": env_delegate.get_train_steps(agent_name),
						"print_logs": false,
						"checkpoint_name": agent_name,
					}
				)
			)
	for sim in sims:
		sim.cleanup_simulation()
	return _mean_score(replays)


func _play_round(sims: Array, deterministic: Dictionary) -> Array:
	var replays = []
	var done = {}
	for step in range(env_delegate.get_steps_in_round()):
		var moves = []
		for sim in sims:
			for i in range(sim.get_agents_count()):
				if !done.has([sim, i]):
					moves.append(
						{
							"sim": sim,
							"index": i,
							"name": sim.get_agent_name(i),
							"state": sim.get_state(i)
						}
					)
		if moves.is_empty():
			break
		_act(moves, deterministic)
		await get_tree().physics_frame
		await get_tree().physics_frame
		for move in moves:
			var is_done = move["sim"].is_game_complete(move["index"])
			if is_done:
				done[[move["sim"], move["index"]]] = true
			if !deterministic[move["name"]]:
				(
					replays
					. append(
						{
							"state": move["state"],
							"action": move["action"],
							"reward": move["sim"].get_score(move["index"]),
							"state_": move["sim"].get_state(move["index"]),
							"done": int(is_done),
							"agent_name": move["name"],
						}
					)
				)
		env_delegate.display_simulation(sims[0])
	return replays


func _act(moves: Array, deterministic: Dictionary):
	var states = {}
	for move in moves:
		states[move["name"]] = states.get(move["name"], []) + move["state"]
	var answer = (
		_server
		. ask(
			{
				"command": "get_batch_actions",
				"deterministic_map": deterministic,
				"path": _server.write_file("batch_state.json", states),
			}
		)
	)
	var actions = _server.read_file(answer["path"])
	var taken = {}
	for move in moves:
		var first = taken.get(move["name"], 0)
		var size = env_delegate.get_action_dim(move["name"])
		var action: Array[float] = []
		for i in range(first, first + size):
			action.append(actions[move["name"]][i])
		taken[move["name"]] = first + size
		move["action"] = action
		move["sim"].apply_action(move["index"], action, null)


static func _mean_score(replays: Array) -> float:
	var total = 0.0
	for replay in replays:
		total += replay["reward"]
	return total / max(replays.size(), 1)
