"""Pictures a second that agents get from their cameras: `python benchmarks/cameras.py`.

A box turns over a floor in the light, or on the canvas in 2D; each world has one camera, and a step
is a tick. Where there is no screen, the engine draws by software under Xvfb.
"""

from __future__ import annotations

import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro

from ludus.addon import install_addon
from ludus.engine import EngineKind
from ludus.session import EngineSession, LaunchOptions, open_session
from ludus.spec.batch import ActionBatch
from ludus.target import Scene, parse_target, prepare
from ludus.wire.handshake import EngineConfig
from ludus.wire.reset import ResetRequest

NUM_ROUNDS = 8

PROJECTS = {
    EngineKind.GODOT3: 'config_version=4\n[application]\nconfig/name="Cameras"\n',
    EngineKind.GODOT4: 'config_version=5\n[application]\nconfig/name="Cameras"\n'
    'config/features=PackedStringArray("4.4")\n',
}
SCRIPT = """\
extends {root}
func apply_action(_action: int) -> void:
	$Box.rotate{y}(0.1)
func get_observation() -> Dictionary:
	return {{"eye": $Eye.get_image()}}
func get_reward() -> float:
	return 0.0
func is_done() -> bool:
	return false
func reset() -> void:
	pass
"""
HEAD = """\
[gd_scene format={version}]
[ext_resource path="res://eye_{kind}.gd" type="Script" id="1"]
[ext_resource path="res://addons/ludus/ludus_agent.gd" type="Script" id="2"]
[ext_resource path="res://addons/ludus/ludus_action_component.gd" type="Script" id="3"]
[ext_resource path="res://addons/ludus/ludus_camera_{kind}.gd" type="Script" id="4"]
[sub_resource type="Resource" id="1"]
script = ExtResource("3")
[sub_resource type="{box}" id="2"]
[sub_resource type="PlaneMesh" id="3"]
size = Vector2(20, 20)
[node name="Root" type="{root}"]
script = ExtResource("1")
"""
NODES_3D = """\
[node name="Box" type="{mesh}" parent="."]
transform = {transform}(1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, -3)
mesh = SubResource("2")
[node name="Floor" type="{mesh}" parent="."]
transform = {transform}(1, 0, 0, 0, 1, 0, 0, 0, 1, 0, -1, 0)
mesh = SubResource("3")
[node name="Sun" type="{light}" parent="."]
transform = {transform}(1, 0, 0, 0, 0.6, 0.8, 0, -0.8, 0.6, 0, 5, 0)
[node name="Eye" type="{camera}" parent="."]
script = ExtResource("4")
"""
NODES_2D = """\
[node name="Box" type="Polygon2D" parent="."]
polygon = {points}(-40, -40, 40, -40, 40, 40, -40, 40)
[node name="Eye" type="Node2D" parent="."]
script = ExtResource("4")
"""
AGENT = """\
[node name="LudusAgent" type="Node" parent="."]
script = ExtResource("2")
ticks_per_step = 1
action = {action}
"""
WORDS = {
    EngineKind.GODOT3: {
        "version": 2,
        "box": "CubeMesh",
        "mesh": "MeshInstance",
        "transform": "Transform",
        "light": "DirectionalLight",
        "camera": "Camera",
        "points": "PoolVector2Array",
        "action": '[ SubResource("1") ]',
    },
    EngineKind.GODOT4: {
        "version": 3,
        "box": "BoxMesh",
        "mesh": "MeshInstance3D",
        "transform": "Transform3D",
        "light": "DirectionalLight3D",
        "camera": "Camera3D",
        "points": "PackedVector2Array",
        "action": 'Array[ExtResource("3")]([SubResource("1")])',
    },
}


@dataclass(frozen=True)
class Settings:
    """What to measure.

    Attributes:
        num_worlds: Worlds, each with one camera.
        seconds: How long each of eight rounds takes; the best one counts.
    """

    num_worlds: int = 16
    seconds: float = 1.0


def main(settings: Settings) -> None:
    """Measure both engines, 3D and 2D, and print a table."""
    print("| engine | scene | layout | images/s of 84 × 84 × 3 |\n|---|---|---|---|")
    for engine in (EngineKind.GODOT4, EngineKind.GODOT3):
        with tempfile.TemporaryDirectory() as folder:
            write_project(Path(folder), engine)
            for kind in ("3d", "2d"):
                for layout in ("isolated", "grid"):
                    speed = images_per_s(Path(folder), kind, layout, settings)
                    print(f"| {engine} | {kind.upper()} | {layout} | {speed:,.0f} |", flush=True)


def write_project(folder: Path, engine: EngineKind) -> None:
    """Write a project with two scenes, ``eye_3d`` and ``eye_2d``."""
    (folder / "project.godot").write_text(PROJECTS[engine])
    for kind, nodes in (("3d", NODES_3D), ("2d", NODES_2D)):
        spatial = "Node3D" if engine is EngineKind.GODOT4 else "Spatial"
        words = {**WORDS[engine], "kind": kind, "root": spatial if kind == "3d" else "Node2D"}
        scene = (HEAD + nodes + AGENT).format(**words)
        if engine is EngineKind.GODOT3:
            for i in range(1, 5):
                scene = scene.replace(f'Resource("{i}")', f"Resource( {i} )")
                scene = scene.replace(f'id="{i}"', f"id={i}")
        (folder / f"eye_{kind}.tscn").write_text(scene)
        script = SCRIPT.format(root=words["root"], y="_y" if kind == "3d" else "")
        (folder / f"eye_{kind}.gd").write_text(script)
    # Godot 4 has the scripts in folders of the add-on; installing it rewrites the scenes.
    install_addon(folder)


def images_per_s(folder: Path, kind: str, layout: str, settings: Settings) -> float:
    """Return how many pictures a second a scene gives."""
    target = prepare(parse_target(folder, scene=f"res://eye_{kind}.tscn"))
    assert isinstance(target, Scene)
    config = EngineConfig(num_worlds=settings.num_worlds, layout=layout)
    session = open_session(target, config, LaunchOptions(has_renderer=True))
    session.reset(ResetRequest.all_worlds(settings.num_worlds, 0))
    rounds = [steps_per_s(session, settings.seconds) for _ in range(NUM_ROUNDS)]
    session.close()
    return max(rounds) * settings.num_worlds


def steps_per_s(session: EngineSession, seconds: float) -> float:
    """Take steps for so long."""
    num_agents = session.spec.num_worlds
    nothing = np.zeros((num_agents, 0), np.float32)
    actions = {"agent": ActionBatch(np.zeros((num_agents, 1), np.int64), nothing)}
    began, num_steps = time.perf_counter(), 0
    while time.perf_counter() - began < seconds:
        session.send(actions)
        session.receive()
        num_steps += 1
    return num_steps / (time.perf_counter() - began)


if __name__ == "__main__":
    main(tyro.cli(Settings))
