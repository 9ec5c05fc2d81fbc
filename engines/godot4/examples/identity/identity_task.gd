extends Node2D
## Shows what earns the reward of the next action: the smallest thing that can be learned.
##
## Every step brings a new task. Tests use these scenes: no physics, a known best return.

## Steps in an episode, unless the world's parameter [code]length[/code] says otherwise.
@export var length: int = 10

var _world: LudusWorld
var _step: int = 0
var _reward: float = 0.0


func _ready() -> void:
	_world = LudusWorld.of(self)


## Returns what the last action earned.
func get_reward() -> float:
	return _reward


## Returns whether the episode has had its steps.
func is_done() -> bool:
	return _step >= int(_world.parameters.get("length", length))


## Begins an episode with a new task.
func reset() -> void:
	_step = 0
	_reward = 0.0
	_draw_task()


## Closes a step: keeps its reward and draws the next task.
func _finish_step(reward: float) -> void:
	_step += 1
	_reward = reward
	_draw_task()


## Draws what the next action has to be from the world's random stream.
func _draw_task() -> void:
	pass
