extends Node2D
## A world of oracles whose episodes end together.
##
## Policy "runner": Early ends after [code]early_length[/code] steps (2) and waits; Leaver frees
## itself in step [code]leave_at[/code]; one more runner joins at the end of step
## [code]join_at[/code]. Policy "watcher": Watcher ends after [code]length[/code] steps (5). The
## names in code font are parameters of the world.

const RUNNER := preload("res://examples/identity/runner.tscn")
## As the agents declare it.
const TICKS_PER_STEP := 2

var _world: LudusWorld
var _ticks: int = 0


func _ready() -> void:
	_world = LudusWorld.of(self)
	if _world.connect("episode_started", self, "_on_episode_started") != OK:
		push_error("the world has no signal episode_started")


func _physics_process(_delta: float) -> void:
	_ticks += 1
	if _ticks == int(_world.parameters.get("join_at", 0)) * TICKS_PER_STEP:
		_add_runner()


func _add_runner() -> void:
	var runner := RUNNER.instance()
	runner.name = "Late"
	add_child(runner)


func _on_episode_started() -> void:
	_ticks = 0
