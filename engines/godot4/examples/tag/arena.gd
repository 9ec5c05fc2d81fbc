extends Node2D
## A walled square with five pillars in which a chaser hunts a runner.
##
## Moves both and deals out the rewards, which add up to zero. Everything is local to this node, and
## there are no physics bodies, so a copy in the grid is equal to a single world to the bit.

## Emitted at the end of a round.
signal round_ended(is_caught: bool)

const Body := preload("res://examples/tag/body.gd")
const InWindow := preload("res://examples/shared/in_window.gd")
const Round := preload("res://examples/tag/round.gd")

## The round that is being played.
var game := Round.new()

@onready var _chaser: Body = $Chaser
@onready var _runner: Body = $Runner


func _enter_tree() -> void:
	LudusWorld.of(self)


func _ready() -> void:
	for body: Body in [_chaser, _runner]:
		body.game = game
	_chaser.other = _runner
	_runner.other = _chaser
	InWindow.show(self)


func _physics_process(delta: float) -> void:
	if game.is_over:
		return
	_chaser.move(delta)
	_runner.move(delta)
	var reward := game.advance(_chaser.position, _runner.position)
	_chaser.earn(reward)
	_runner.earn(-reward)
	if game.is_over:
		round_ended.emit(game.is_caught)
