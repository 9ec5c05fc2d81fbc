extends "ludus_test.gd"
## Base of tests in which policies play stub agents.

const StubAgent := preload("stub_agent.gd")
const GoldenPolicy := preload("golden_policy.gd")

## Episodes that ended: policy name, id of the agent (0: it has left), return, steps.
var _ended: Array = []


func _golden(name: String) -> GoldenPolicy:
	return GoldenPolicy.new(golden_folder, name)


## Agents that the policy fits, each in a world of its own.
func _agents(golden: GoldenPolicy, count: int) -> Array:
	var agents := []
	var read := golden.policy.reader()
	for _i in count:
		var agent := StubAgent.new()
		agent.policy_name = "stub"
		agent.policy = golden.policy
		for entry in read.entries:
			agent.observation.append(entry.duplicate())
		for part in read.components:
			agent.action.append(part.duplicate())
		agent.has_action_mask = read.has_action_mask
		var zeros := PoolRealArray()
		zeros.resize(read.entries[0].size())
		zeros.fill(0.0)
		agent.seen = zeros
		add(agent)
		agents.append(agent)
	return agents


## Moves agents under the root of a world, or a new one, which they share.
func _in_one_world(agents: Array, shared: LudusWorld = null) -> Array:
	var world := shared if shared != null else _world()
	for agent in agents:
		agent.get_parent().remove_child(agent)
		world.root.add_child(agent)
		agent.world = world
	return agents


func _world() -> LudusWorld:
	var root := Node.new()
	add(root)
	var world := LudusWorld.new()
	root.add_child(world)
	world.attach(root)
	return world


func _player() -> LudusPolicyPlayer:
	var player := LudusPolicyPlayer.new()
	add(player)
	equal(player.connect("episode_ended", self, "_note_end"), OK, "connect")
	return player


func _advance(player: LudusPolicyPlayer, num_ticks: int) -> void:
	for _tick in num_ticks:
		player.advance()


func _note_end(name: String, agent: LudusAgent, total: float, num_steps: int) -> void:
	_ended.append([name, agent.get_instance_id() if agent != null else 0, total, num_steps])
