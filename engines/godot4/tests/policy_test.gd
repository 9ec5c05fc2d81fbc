extends "ludus_test.gd"
## Base of tests in which policies play stub agents.

const StubAgent := preload("stub_agent.gd")
const GoldenPolicy := preload("golden_policy.gd")

## Episodes that ended: policy name, id of the agent (0: it has left), return, steps.
var _ended: Array[Array] = []


func _golden(name: String) -> GoldenPolicy:
	return GoldenPolicy.read(golden_folder, name)


## Agents that the policy fits, each in a world of its own.
func _agents(golden: GoldenPolicy, count: int) -> Array[StubAgent]:
	var agents: Array[StubAgent] = []
	var read := golden.policy.reader()
	for i: int in count:
		var agent := StubAgent.new()
		agent.policy_name = "stub"
		agent.policy = golden.policy
		for entry: LudusObservationEntry in read.entries:
			agent.observation.append(entry.duplicate() as LudusObservationEntry)
		for part: LudusActionComponent in read.components:
			agent.action.append(part.duplicate() as LudusActionComponent)
		agent.has_action_mask = read.has_action_mask
		var zeros := PackedFloat32Array()
		zeros.resize(read.entries[0].size())
		agent.seen = zeros
		add(agent)
		agents.append(agent)
	return agents


## Moves agents under one root, whose world they share.
func _in_one_world(
	agents: Array[StubAgent], is_there: bool, world: LudusWorld = null
) -> Array[StubAgent]:
	if not is_there:
		var root := Node.new()
		add(root)
		world = LudusWorld.new()
		root.add_child(world)
		world.attach(root)
	for agent: StubAgent in agents:
		agent.reparent(world.root)
		agent.world = world
	return agents


func _player() -> LudusPolicyPlayer:
	var player := LudusPolicyPlayer.new()
	add(player)
	player.episode_ended.connect(_note_end)
	return player


func _advance(player: LudusPolicyPlayer, num_ticks: int) -> void:
	for tick: int in num_ticks:
		player.advance()


func _note_end(name: String, agent: LudusAgent, total: float, num_steps: int) -> void:
	_ended.append([name, agent.get_instance_id() if agent != null else 0, total, num_steps])
