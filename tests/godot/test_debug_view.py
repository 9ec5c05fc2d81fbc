"""The debug view in a game that a trainer steps: it shows what is sent, and changes nothing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ludus.play.watched import WatchedPlayer
from ludus.pool import EnginePool, PoolConfig, open_pool
from ludus.record.screen import screen
from ludus.session import LaunchOptions
from ludus.spec.batch import ActionBatch, Batches
from tests.godot_project import AGENT_SCENE, write_project

pytestmark = [pytest.mark.engine, pytest.mark.screen]

SHOW, NEXT = 4194335, 4194337
"""Godot's numbers of F4 and F6."""
# It draws a random number whenever it is asked, so that one question too many would show.
GAME = """\
extends Node2D
var ticks := 0

func _physics_process(_delta: float) -> void:
	ticks += 1

func apply_action(_action: int) -> void:
	pass

func get_observation() -> Dictionary:
	var world := LudusWorld.of(self)
	return {"near": [world.rng.randf(), float(world.index)], "far": PackedByteArray([ticks, 7, 9])}

func get_reward() -> float:
	return 0.25

func is_done() -> bool:
	return ticks >= 6

func reset() -> void:
	ticks = 0

func ludus_press(key: int) -> void:
	for pressed: bool in [true, false]:
		var event := InputEventKey.new()
		event.keycode = key as Key
		event.pressed = pressed
		Input.parse_input_event(event)
		Input.flush_buffered_events()

func ludus_watched() -> Variant:
	var view: LudusDebugView = preload("res://addons/ludus/bridge/registry.gd").debug_view
	var watched := view.watched
	if not view.visible:
		return null
	var seen := []
	for i: int in watched.seen.size():
		var entry := watched.layout().entries[i]
		seen.append(Array(view.LudusDebugPanel.floats_of(entry, watched.seen[i])))
	return {
		"seen": seen,
		"choices": Array(watched.choices),
		"probabilities": Array(watched.probabilities),
		"value": null if is_nan(watched.value) else watched.value,
		"returns": Array(watched.returns),
		"title": view.get_child(0).get("title"),
	}
"""
ROOT = {"world": 0}


class Coin:
    """Takes 0 and 1 in turn, and says how sure it was."""

    def __init__(self, pool: EnginePool) -> None:
        self._pool = pool
        self.num_steps = 0
        self.asked: list[int] = []

    def __call__(self, batches: Batches) -> Mapping[str, ActionBatch]:
        self.num_steps += 1
        actions = ActionBatch.zeros(self._pool.policies["agent"], 2)
        actions.discrete[:, 0] = [self.num_steps % 2, 1]
        return {"agent": actions}

    def describe(self, policy: str, slot: int) -> dict[str, Any]:
        self.asked.append(slot)
        return {"probabilities": [0.25, 0.75], "means": [], "deviations": [], "value": 2.5 + slot}


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    scene = AGENT_SCENE["godot4"].format(script="game", root="Node2D")
    files = {"game.gd": GAME, "game.tscn": scene}
    return write_project(tmp_path_factory.mktemp("debug") / "game", files, main="game")


@pytest.fixture
def pool(project: Path) -> Iterator[EnginePool]:
    launch = LaunchOptions(is_windowed=True, has_controls=True)
    with screen(), open_pool(str(project), PoolConfig(num_worlds=2, launch=launch)) as pool:
        yield pool


def press(pool: EnginePool, key: int) -> None:
    pool.call(ROOT, "ludus_press", [key])


def watched(pool: EnginePool) -> Any:
    (seen,) = pool.call(ROOT, "ludus_watched")
    return seen


def play(pool: EnginePool, keys: Mapping[int, int], num_steps: int) -> list[Batches]:
    coin = Coin(pool)
    act = WatchedPlayer(pool, coin)
    batches = [pool.reset(3)]
    for step in range(num_steps):
        if step in keys:
            press(pool, keys[step])
        batches.append(pool.step(act(batches[-1])))
    return batches


def test_it_shows_what_is_sent_and_told(pool: EnginePool) -> None:
    coin = Coin(pool)
    act = WatchedPlayer(pool, coin)
    batches = pool.step(act(pool.reset(3)))
    assert watched(pool) is None
    press(pool, SHOW)
    for _ in range(2):  # with the answer to the first one it asks to be told of decisions
        batches = pool.step(act(batches))
    seen = watched(pool)
    observation = batches["agent"].observation
    assert seen["seen"] == [observation["near"][0].tolist(), observation["far"][0].tolist()]
    assert seen["choices"] == [1]
    assert (seen["probabilities"], seen["value"]) == ([0.25, 0.75], 2.5)
    assert coin.asked == [0]
    assert "agent  world 0" in seen["title"]
    # Six ticks, three steps, are an episode. The view saw the third one.
    assert seen["returns"] == [0.25]
    batches = pool.step(act(batches))
    assert watched(pool)["returns"] == [0.25, 0.25]

    press(pool, NEXT)
    for _ in range(2):
        batches = pool.step(act(batches))
    seen = watched(pool)
    assert "agent  world 1" in seen["title"]
    assert seen["seen"][0] == batches["agent"].observation["near"][1].tolist()
    assert (seen["choices"], seen["value"]) == ([1], 3.5)
    press(pool, SHOW)
    num_asked = len(coin.asked)
    for _ in range(3):
        batches = pool.step(act(batches))
    assert watched(pool) is None
    assert len(coin.asked) <= num_asked + 1, "hidden, it costs nothing"


def test_the_game_is_the_same(pool: EnginePool) -> None:
    plain = play(pool, {}, 12)
    shown = play(pool, {2: SHOW, 6: NEXT}, 12)
    for one, other in zip(plain, shown, strict=True):
        for name, values in one["agent"].observation.items():
            np.testing.assert_array_equal(values, other["agent"].observation[name])
