"""Sensors in real Godot: right after a reset, in both layouts, in training and in the game."""

from __future__ import annotations

import contextlib
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ludus
from ludus.check import CheckConfig, CheckContext, Status, run_checks
from ludus.check.resets import check_resets
from ludus.engine import EngineKind, find_engine
from ludus.pool import PoolConfig, open_pool
from ludus.settings.train_config import PPOConfig, TrainConfig
from tests.godot_project import write_project

pytestmark = pytest.mark.engine

# The wall and the agent are put somewhere by reset(). What the rays must say is arithmetic, which
# the game tells beside them.
GAME_2D = """\
extends CharacterBody2D
var push := 0.0
var distance := 0.0
@onready var wall: {wall} = get_node("../Wall")

func _physics_process(_delta: float) -> void:
	velocity = Vector2(push * 60.0, 0.0)
	move_and_slide()

func apply_action(action: int) -> void:
	push = 1.0 if action == 1 else -1.0

func get_observation() -> PackedFloat32Array:
	return PackedFloat32Array([(wall.position.x - 16.0 - position.x) / 200.0])

func get_reward() -> float:
	return 0.0

func is_done() -> bool:
	return false

func reset() -> void:
	var rng := LudusWorld.of(self).rng
	position = Vector2(rng.randf_range(0.0, 20.0), 0.0)
	wall.position = Vector2(rng.randf_range(90.0, 200.0), 0.0)
	push = 0.0
"""
GAME_3D = (
    GAME_2D.replace("2D", "3D")
    .replace("Vector2(push * 60.0, 0.0)", "Vector3(push, 0.0, 0.0)")
    .replace("Vector2(rng", "Vector3(rng")
    .replace(", 0.0)\n", ", 0.0, 0.0)\n")
    .replace("push, 0.0, 0.0, 0.0", "push, 0.0, 0.0")
    .replace("- 16.0 ", "- 0.5 ")
)

OWN_SENSOR = """\
@tool
extends LudusSensor2D

func count_values() -> int:
	return 2

func sense() -> PackedFloat32Array:
	var place := transform_in_world(own_body()).origin
	return PackedFloat32Array([place.x / 1000.0, place.y / 1000.0])
"""

SCENE = """\
[gd_scene format=3]
[ext_resource path="res://game_{d}.gd" type="Script" id="1"]
[ext_resource path="res://addons/ludus/agent/ludus_agent.gd" type="Script" id="2"]
[ext_resource path="res://addons/ludus/agent/ludus_action_component.gd" type="Script" id="3"]
[ext_resource path="res://addons/ludus/sensors/ludus_rays_{d}.gd" type="Script" id="4"]
[ext_resource path="res://addons/ludus/world/ludus_world.gd" type="Script" id="5"]
[ext_resource path="res://own.gd" type="Script" id="6"]
[sub_resource type="Resource" id="action"]
script = ExtResource("3")
[sub_resource type="{shape}" id="shape"]
size = {size}
[sub_resource type="{shape}" id="small"]
size = {small}
[node name="Game" type="Node{D}"]
[node name="World" type="Node" parent="."]
script = ExtResource("5")
layout = {layout}
spacing = Vector3(1024, {y}, 1024)
[node name="Wall" type="{wall}{D}" parent="." groups=["walls"]]
[node name="Shape" type="CollisionShape{D}" parent="Wall"]
shape = SubResource("shape")
[node name="Body" type="CharacterBody{D}" parent="."]
script = ExtResource("1")
[node name="Shape" type="CollisionShape{D}" parent="Body"]
shape = SubResource("small")
[node name="Rays" type="Node{D}" parent="Body"]
{turn}script = ExtResource("4")
count = 1
reach = 200.0
hit_groups = Array[StringName]([&"walls"])
[node name="LudusAgent" type="Node" parent="Body"]
script = ExtResource("2")
action = Array[ExtResource("3")]([SubResource("action")])
max_episode_steps = 6
"""


def write_game(folder: Path, dimension: str, layout: str, wall: str) -> Path:
    is_2d = dimension == "2d"
    scene = SCENE.format(
        d=dimension,
        D=dimension.upper(),
        shape="RectangleShape2D" if is_2d else "BoxShape3D",
        size="Vector2(32, 32)" if is_2d else "Vector3(1, 1, 1)",
        small="Vector2(4, 4)" if is_2d else "Vector3(0.5, 0.5, 0.5)",
        layout=int(layout == "grid"),
        y=1024 if is_2d else 0,
        wall=wall,
        turn="" if is_2d else "transform = Transform3D(0, 0, -1, 0, 1, 0, 1, 0, 0, 0, 0, 0)\n",
    )
    if is_2d:  # with a sensor of its own
        own = '[node name="Place" type="Node2D" parent="Body"]\nscript = ExtResource("6")\n'
        scene = scene.replace('[node name="LudusAgent"', own + '[node name="LudusAgent"')
    script = (GAME_2D if is_2d else GAME_3D).format(wall=f"{wall}{dimension.upper()}")
    files = {f"game_{dimension}.gd": script, "game.tscn": scene, "own.gd": OWN_SENSOR}
    return write_project(folder, files, main="game", more=NO_GRAVITY)


NO_GRAVITY = "[physics]\n2d/default_gravity=0.0\n3d/default_gravity=0.0\n"


@pytest.mark.parametrize("wall", ["StaticBody", "CharacterBody", "RigidBody", "Area"])
@pytest.mark.parametrize("dimension", ["2d", "3d"])
def test_bodies_are_where_reset_has_put_them(tmp_path: Path, dimension: str, wall: str) -> None:
    game = write_game(tmp_path / "game", dimension, "isolated", wall)
    if wall == "Area":
        scene = game / "game.tscn"
        text = scene.read_text().replace("count = 1\n", "count = 1\ncollide_with_areas = true\n")
        scene.write_text(text)
    with contextlib.closing(ludus.make_vec(str(game), num_worlds=3)) as env:
        seen, _ = env.reset(seed=5)
        told = [seen["observation"][:, 0]]
        rays = [seen["Rays"]]
        for _ in range(7):  # over the end of an episode
            seen, *_ = env.step(np.ones(3, np.int64))
            told.append(seen["observation"][:, 0])
            rays.append(seen["Rays"])
    # 6 steps end the episode, so that the 7th observation is the first of the next one.
    for step in (0, 6):
        np.testing.assert_allclose(rays[step][:, 0], told[step], atol=2e-5, err_msg=f"{step}")
        assert (rays[step][:, 1] == 1.0).all(), "it is in the group"
    assert len({*rays[0][:, 0], *rays[6][:, 0]}) == 6, "each world and episode has its own"


@pytest.mark.games
@pytest.mark.parametrize(("dimension", "layout"), [("2d", "isolated"), ("3d", "grid")])
def test_a_game_with_sensors_passes_the_check(tmp_path: Path, dimension: str, layout: str) -> None:
    game = write_game(tmp_path / "game", dimension, layout, "StaticBody")
    report = run_checks(CheckConfig(target=game, num_steps=40, num_layout_worlds=8, timing_s=0.1))
    wrong = [finding for _, finding in report.findings if finding.status is Status.FAIL]
    assert not wrong, wrong
    titles = [finding.title for _, finding in report.findings]
    assert any("Rays: 2 float32" in title for title in titles), titles
    if dimension == "2d":
        assert any("Place: 2 float32" in title for title in titles), titles
    assert len(OWN_SENSOR.splitlines()) < 30


OWN_RAY = """\
func get_observation() -> PackedFloat32Array:
	var ray: RayCast2D = $Ray
	ray.force_raycast_update()
	return PackedFloat32Array([ray.get_collision_point().x / 200.0])

func told() -> PackedFloat32Array:
"""


DRAWN = """
func ludus_drawn() -> Array:
	var rays: LudusRays3D = $Rays
	rays.draw_in_game(true)
	var seen := rays.sense()
	var mesh: Mesh = (rays.get_child(-1, true) as MeshInstance3D).mesh
	return [seen[0], mesh.get_aabb().size.length() / rays.reach]
"""


def test_a_drawn_ray_ends_where_it_hits(tmp_path: Path) -> None:
    game = write_game(tmp_path / "game", "3d", "isolated", "StaticBody")
    script = game / "game_3d.gd"
    script.write_text(script.read_text() + DRAWN)
    with open_pool(str(game), PoolConfig(num_worlds=1)) as pool:
        pool.reset(5)
        agent = {"world": 0, "agent": "Body/LudusAgent"}
        ((seen, drawn),) = pool.call(agent, "ludus_drawn")
    assert 0.0 < seen < 1.0
    assert drawn == pytest.approx(seen, abs=1e-5)


def test_the_check_names_rays_that_a_game_casts_after_a_reset(tmp_path: Path) -> None:
    game = write_game(tmp_path / "game", "2d", "isolated", "StaticBody")
    script, scene = game / "game_2d.gd", game / "game.tscn"
    observe = "func get_observation() -> PackedFloat32Array:\n"
    script.write_text(script.read_text().replace(observe, OWN_RAY))
    ray = '[node name="Ray" type="RayCast2D" parent="Body"]\ntarget_position = Vector2(200, 0)\n'
    agent = '[node name="LudusAgent"'
    text = scene.read_text().replace("count = 1\n", "count = 1\nis_entry = false\n")
    scene.write_text(text.replace(agent, ray + agent))
    with CheckContext(CheckConfig(target=game, num_steps=12)) as context:
        (found, *_) = check_resets(context)
    assert found.status is Status.FAIL
    line = script.read_text().splitlines().index("\tray.force_raycast_update()") + 1
    assert found.hint.startswith(f"res://game_2d.gd:{line} looks into the physics space"), found


def test_layouts_see_the_same_bits_at_the_start(tmp_path: Path) -> None:
    seen: dict[str, Any] = {}
    for layout in ("isolated", "grid"):
        game = write_game(tmp_path / layout, "2d", layout, "StaticBody")
        with contextlib.closing(ludus.make_vec(str(game), num_worlds=4)) as env:
            seen[layout], _ = env.reset(seed=5)
    for entry, values in seen["grid"].items():
        if entry != "Rays":
            np.testing.assert_array_equal(values, seen["isolated"][entry], entry)
        # Physics itself rounds what it computes at the place of the copy.
        np.testing.assert_allclose(values, seen["isolated"][entry], atol=1e-6, err_msg=entry)


def test_a_policy_plays_with_sensors_in_the_game(tmp_path: Path) -> None:
    game = write_game(tmp_path / "game", "2d", "isolated", "StaticBody")
    run = ludus.train(
        TrainConfig(
            target=str(game), num_worlds=2, num_engines=1, total_steps=64, seed=7,
            runs=tmp_path / "runs", name="run", evaluation_episodes=0,
            ppo=PPOConfig(rollout_steps=8, hidden_sizes=(8,)),
        ),
        progress=False,
    )  # fmt: skip
    (file,) = run.export(tmp_path / "agent.ludus.json").values()
    command = [str(find_engine(EngineKind.GODOT4).executable(headless=True)), "--headless"]
    command += ["--fixed-fps", "60", "--quit-after", "60", "--path", str(game), "--"]
    command += [f"--ludus-policy=agent={file}", "--ludus-report"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert "ERROR" not in done.stderr, done.stderr
    assert done.stderr.count("ludus-episode ") >= 3, done.stderr
