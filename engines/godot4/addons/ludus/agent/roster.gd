extends RefCounted
## The agents of this process: who is in the tree, who has come and who has gone.

## Agents in the tree, in the order in which they came.
static var agents: Dictionary[LudusAgent, bool] = {}
## Those of them that no batch has taken yet.
static var newcomers: Dictionary[LudusAgent, bool] = {}
## Whether any agent has left since somebody asked last.
static var has_leavers: bool = false
## Goes up whenever an agent comes, goes, or is to be played by something else.
static var num_changes: int = 0


## Notes that an agent has entered the tree.
static func add(agent: LudusAgent) -> void:
	agents[agent] = true
	newcomers[agent] = true
	num_changes += 1


## Notes that an agent is leaving the tree.
static func remove(agent: LudusAgent) -> void:
	agents.erase(agent)
	newcomers.erase(agent)
	has_leavers = true
	num_changes += 1


## Returns the agents that no batch has taken, and forgets that they are new.
static func take_newcomers() -> Array[LudusAgent]:
	var taken: Array[LudusAgent] = []
	taken.assign(newcomers.keys())
	newcomers.clear()
	return taken
