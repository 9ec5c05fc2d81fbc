"""A Godot game that is learned by lessons only: nobody finds its goal by chance.

At every step of the way there are three signs. Where most of them point to the left, the way goes
left; a wrong turn ends the episode. The only reward is at the goal, 30 steps away, which random
turns reach once in 2³⁰ episodes.
"""

from __future__ import annotations

from pathlib import Path

from tests.godot_project import AGENT_SCENE, write_project

GAME = """\
extends Node

var signs := [1.0, 1.0, 1.0]
var steps := 0
var length := 30
var wind := 0.0
var is_lost := false

func reset() -> void:
	var world := LudusWorld.of(self)
	length = int(world.parameters.get("length", 30))
	wind = world.parameters.get("wind", 0.0)
	steps = 0
	is_lost = false
	draw_signs()

func draw_signs() -> void:
	var rng := LudusWorld.of(self).rng
	for i in 3:
		signs[i] = 1.0 if rng.randf() < 0.5 else -1.0

func apply_action(action: int) -> void:
	is_lost = (signs[0] + signs[1] + signs[2] > 0.0) != (action == 1)
	steps += 1
	draw_signs()

func get_observation() -> PackedFloat32Array:
	return PackedFloat32Array([length, wind] + signs)

func get_reward() -> float:
	return 1.0 if steps >= length and not is_lost else 0.0

func is_done() -> bool:
	return is_lost or steps >= length
"""

LESSONS = """\
[[curriculum]]
name = "one step"
parameters = { length = 1 }
until_return = 0.95

[[curriculum]]
name = "some steps"
parameters = { length = { choice = [2, 4, 8] } }
until_return = 0.9

[[curriculum]]
name = "whole way"
"""


def write_signposts(folder: Path) -> Path:
    """Write the project into a folder, and return that."""
    scene = AGENT_SCENE["godot4"].format(script="game", root="Node")
    scene = scene.replace("action = ", "ticks_per_step = 1\naction = ")
    return write_project(folder, {"game.gd": GAME, "game.tscn": scene}, main="game")
