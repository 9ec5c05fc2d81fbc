"""A small Godot 3 project, made by ``ludus addon install``, and a real engine to run it."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from ludus.addon import install_addon
from ludus.engine import EngineKind, InstalledEngine, find_engine
from tests.godot.conftest import Game

PROJECT = """\
config_version=4

[application]

config/name="Games"
run/main_scene="res://right.tscn"

[logging]

file_logging/enable_file_logging=false
"""

# Counts its steps, and goes wrong at step 3 in the way that the parameter `fault` names.
GAME = """\
extends Node
var steps := 0
var fault := ""
func ludus_is(name: String) -> bool:
	return fault == name and steps == 3
func apply_action(_action: int) -> void:
	if ludus_is("apply_action"):
		var nobody: Node = null
		nobody.queue_free()
	while ludus_is("hang"):
		pass
func get_observation():
	if ludus_is("get_observation"):
		var nothing = null
		return nothing.size()
	if ludus_is("size"):
		return PoolRealArray([1.0])
	return {"steps": [steps], "rays": PoolRealArray([1, NAN if ludus_is("nan") else 2.0, 3])}
func get_reward() -> float:
	steps += 1
	return INF if ludus_is("reward") else 1.0
func is_done() -> bool:
	return false
func reset() -> void:
	steps = 0
	fault = LudusWorld.of(self).parameters.get("fault", "")
"""

# Extends the agent itself, declares its spaces in code, and counts calls, ticks and resets.
COUNTER = """\
extends LudusAgent
var applied := 0
var ticks := 0
var resets := 0
var last := {}
func _init() -> void:
	action = [LudusActionComponent.discrete("move", 3), LudusActionComponent.continuous("aim", 2)]
	observation = [LudusObservationEntry.create("counts", PoolIntArray([3]))]
func _physics_process(_delta: float) -> void:
	ticks += 1
func apply_action(given: Dictionary) -> void:
	applied += 1
	last = given
func get_observation() -> Dictionary:
	return {"counts": [applied, ticks, resets]}
func get_reward() -> float:
	return 1.0
func is_done() -> bool:
	return false
func reset() -> void:
	applied = 0
	ticks = 0
	resets += 1
func ludus_last() -> Dictionary:
	var is_real := typeof(last.aim) == TYPE_REAL_ARRAY
	return {"move": last.move, "aim": Array(last.aim), "type": "PoolRealArray" if is_real else ""}
func get_action_mask() -> PoolByteArray:
	return PoolByteArray([1, 0, resets % 2])
"""

# Two bodies of a world that push each other; worlds would, too, if they were not isolated.
BALLS = """\
extends Spatial
func apply_action(action: PoolRealArray) -> void:
	$Ball.apply_central_impulse(Vector3(action[0], 0, 0))
func get_observation() -> PoolRealArray:
	var place: Transform = PhysicsServer.body_get_state($Ball.get_rid(), 0)
	return PoolRealArray([place.origin.x, place.origin.y, $Ball.linear_velocity.x])
func get_reward() -> float:
	return 0.0
func is_done() -> bool:
	return false
func reset() -> void:
	$Ball.transform = Transform(Basis(), Vector3(LudusWorld.of(self).rng.randf_range(-1, 1), 2, 0))
	$Ball.force_update_transform()
	$Ball.linear_velocity = Vector3.ZERO
	$Ball.angular_velocity = Vector3.ZERO
"""

SCRIPTS = {
    "game": GAME,
    "counter": COUNTER,
    "balls": BALLS,
    "no_reset": GAME.replace("func reset(", "func begin("),
    "hangs": GAME + "func _ready() -> void:\n\twhile true:\n\t\tpass\n",
    "broken": GAME + "this is no GDScript\n",
    "quits": GAME + "func _ready() -> void:\n\tvar _error := OS.kill(OS.get_process_id())\n",
}

HEAD = """\
[gd_scene format=2]
[ext_resource path="res://{script}.gd" type="Script" id=1]
[ext_resource path="res://addons/ludus/ludus_agent.gd" type="Script" id=2]
[ext_resource path="res://addons/ludus/ludus_action_component.gd" type="Script" id=3]
[ext_resource path="res://addons/ludus/ludus_world.gd" type="Script" id=4]
[sub_resource type="Resource" id=1]
script = ExtResource( 3 )
[sub_resource type="Resource" id=2]
script = ExtResource( 3 )
kind = 1
[sub_resource type="BoxShape" id=3]
[sub_resource type="SphereShape" id=4]
[node name="Root" type="{root}"]
"""
CART = """\
[node name="Cart" type="Node" parent="."]
script = ExtResource( 1 )
"""
AGENT = """\
[node name="{name}" type="Node" parent="Cart"]
script = ExtResource( 2 )
ticks_per_step = {ticks}
"""
ACTION = "action = [ SubResource( 1 ) ]\n"
RIGHT_AGENT = AGENT.format(name="LudusAgent", ticks=1) + ACTION

COUNTER_AGENT = """\
[node name="{name}" type="Node" parent="."]
script = ExtResource( 1 )
policy_name = "{policy}"
ticks_per_step = 3
action_timing = {timing}
max_episode_steps = 4
has_action_mask = {mask}
enabled = {enabled}
"""
EVERY_TICK, ONCE = 0, 1

BALLS_SCENE = """\
script = ExtResource( 1 )
[node name="Floor" type="StaticBody" parent="."]
[node name="Shape" type="CollisionShape" parent="Floor"]
shape = SubResource( 3 )
[node name="Ball" type="RigidBody" parent="."]
transform = Transform( 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 2, 0 )
can_sleep = false
[node name="Shape" type="CollisionShape" parent="Ball"]
shape = SubResource( 4 )
[node name="LudusAgent" type="Node" parent="."]
script = ExtResource( 2 )
action = [ SubResource( 2 ) ]
max_episode_steps = 40
[node name="LudusWorld" type="Node" parent="."]
script = ExtResource( 4 )
settle_ticks = {settle_ticks}
"""


def counter_agent(
    name: str, policy: str = "agent", timing: int = EVERY_TICK, *, mask: bool = False
) -> str:
    return COUNTER_AGENT.format(
        name=name,
        policy=policy,
        timing=timing,
        mask=str(mask).lower(),
        enabled=str(name != "Idle").lower(),
    )


def head(script: str, root: str = "Node") -> str:
    return HEAD.format(script=script, root=root)


SCENES = {
    "right": head("game") + CART + RIGHT_AGENT,
    "no_agent": head("game") + CART,
    "no_action": head("game") + CART + AGENT.format(name="LudusAgent", ticks=1),
    "disagreeing": head("game") + CART + RIGHT_AGENT + AGENT.format(name="Other", ticks=4) + ACTION,
    "no_reset": head("no_reset") + CART + RIGHT_AGENT,
    **{script: head(script) + CART + RIGHT_AGENT for script in ("hangs", "broken", "quits")},
    "every": head("counter") + counter_agent("Agent") + counter_agent("Idle"),
    "once": head("counter") + counter_agent("Agent", timing=ONCE),
    "masked": head("counter") + counter_agent("Agent", mask=True),
    "masked_unasked": head("counter") + counter_agent("Agent"),
    "several": head("counter")
    + counter_agent("A", "hero")
    + counter_agent("B", "target")
    + counter_agent("C", "hero"),
    "balls": head("balls", "Spatial") + BALLS_SCENE.format(settle_ticks=0),
    "settling": head("balls", "Spatial") + BALLS_SCENE.format(settle_ticks=30),
}


@pytest.fixture(scope="session")
def godot3() -> InstalledEngine:
    """The real engine; a machine without one fails these tests."""
    return find_engine(EngineKind.GODOT3)


def make_project(folder: Path) -> Path:
    """Write a project that no editor has ever seen."""
    (folder / "project.godot").write_text(PROJECT)
    install_addon(folder)
    for name, text in SCRIPTS.items():
        (folder / f"{name}.gd").write_text(text)
    for name, text in SCENES.items():
        (folder / f"{name}.tscn").write_text(text)
    return Path(os.path.realpath(folder))


@pytest.fixture(scope="session")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The project."""
    return make_project(tmp_path_factory.mktemp("games3"))


@pytest.fixture
def game(project: Path) -> Iterator[Game]:
    """Opens scenes of the project; no engine may be left behind."""
    made = Game(project)
    yield made
    made.close()
    assert made.engines() == []
