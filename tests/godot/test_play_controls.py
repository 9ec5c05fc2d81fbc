"""Pause, single step and slow motion in real Godot: the episode stays the same."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ludus.pool import PoolConfig, open_pool
from ludus.session import LaunchOptions
from ludus.spec.batch import ActionBatch
from tests.godot_project import AGENT_SCENE, write_project

pytestmark = pytest.mark.engine

# It presses keys by itself, and counts the ticks that its nodes have lived through.
GAME = """\
extends Node
var ticks := 0
var frames := 0

func _ready() -> void:
	var presser := Presser.new()
	presser.game = self
	add_child(presser)

func _physics_process(_delta: float) -> void:
	ticks += 1

func apply_action(_action: int) -> void:
	pass

func get_observation() -> PackedFloat32Array:
	return PackedFloat32Array([ticks, frames])

func get_reward() -> float:
	return 0.0

func is_done() -> bool:
	return false

func reset() -> void:
	ticks = 0

class Presser extends Node:
	var game: Node
	func _init() -> void:
		process_mode = Node.PROCESS_MODE_ALWAYS
	func _physics_process(_delta: float) -> void:
		game.frames += 1
		if game.ticks == 5 and game.frames < 1000:
			game.frames += 1000
			press(KEY_F1)
		if game.frames == 1040:
			press(KEY_F2)
		if game.frames == 1080:
			press(KEY_F1)
	func press(key: Key) -> void:
		var event := InputEventKey.new()
		event.keycode = key
		event.pressed = true
		Input.parse_input_event(event)
		Input.flush_buffered_events()
"""


@pytest.mark.parametrize("has_controls", [True, False])
def test_a_pause_changes_nothing_in_the_game(tmp_path: Path, has_controls: bool) -> None:
    scene = AGENT_SCENE["godot4"].format(script="game", root="Node")
    files = {"game.gd": GAME, "game.tscn": scene}
    game = write_project(tmp_path / "game", files, main="game")
    config = PoolConfig(launch=LaunchOptions(has_controls=has_controls), num_engines=1)
    with open_pool(str(game), config) as pool:
        start = pool.reset(1)["agent"].observation["observation"][0]
        actions = {"agent": ActionBatch.zeros(pool.policies["agent"], 1)}
        seen = [pool.step(actions)["agent"].observation["observation"][0] for _ in range(12)]
    ticks, frames = (np.array([start, *seen])[:, i] for i in (0, 1))
    assert (np.diff(ticks) == 2).all(), "each step is two ticks, paused or not"
    has_paused = frames[-1] - 1000 > ticks[-1] + 60
    assert has_paused == has_controls, (ticks, frames)
