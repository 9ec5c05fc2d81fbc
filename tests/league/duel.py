"""A game in Godot that the higher choice wins, and players that always make the same choice."""

from __future__ import annotations

from pathlib import Path

import torch

from ludus.league.players import LeaguePlayer
from ludus.networks.policy import Policy
from ludus.settings.train_config import PPOConfig
from ludus.spec import PolicySpec
from tests.godot_project import write_project

NUM_CHOICES = 4
SETTINGS = PPOConfig(hidden_sizes=(4,))

FIGHTER = """\
extends Node
@export var life: int = 3
var steps: int = 0
var choice: int = 0
func apply_action(action: int) -> void:
	choice = action
func get_observation() -> PackedFloat32Array:
	return PackedFloat32Array([steps])
func get_reward() -> float:
	steps += 1
	return choice
func is_done() -> bool:
	return steps == life
func reset() -> void:
	steps = 0
"""

HEAD = f"""\
[gd_scene format=3]
[ext_resource type="Script" path="res://fighter.gd" id="1"]
[ext_resource type="Script" path="res://addons/ludus/agent/ludus_agent.gd" id="2"]
[ext_resource type="Script" path="res://addons/ludus/agent/ludus_action_component.gd" id="3"]
[ext_resource type="Script" path="res://addons/ludus/world/ludus_world.gd" id="4"]
[sub_resource type="Resource" id="a"]
script = ExtResource("3")
name = "choice"
n = {NUM_CHOICES}
[node name="Duel" type="Node"]
[node name="LudusWorld" type="Node" parent="."]
script = ExtResource("4")
episode_mode = 1
"""

FIGHTER_NODE = """\
[node name="Fighter{index}" type="Node" parent="."]
script = ExtResource("1")
life = {life}
[node name="LudusAgent" type="Node" parent="Fighter{index}"]
script = ExtResource("2")
policy_name = "{policy}"
action = Array[ExtResource("3")]([SubResource("a")])
"""

SCENES = {
    "duel": (("hero", 3), ("foe", 3)),
    "mirror": (("twin", 3), ("twin", 3)),
    "trio": (("hero", 3), ("foe", 3), ("third", 3)),
    "squads": (("hero", 1), ("hero", 4), ("foe", 4), ("foe", 4)),
}
"""Policy of each fighter, and the steps after which it dies."""


def make_project(folder: Path) -> Path:
    """Return a project with the scenes of ``SCENES``."""
    files = {"fighter.gd": FIGHTER}
    for scene, fighters in SCENES.items():
        nodes = (
            FIGHTER_NODE.format(index=i, policy=name, life=life)
            for i, (name, life) in enumerate(fighters)
        )
        files[f"{scene}.tscn"] = HEAD + "".join(nodes)
    return write_project(folder, files, main="duel")


def chooser(spec: PolicySpec, choice: int, *, is_newest: bool = False) -> LeaguePlayer:
    """Return a player that always makes the same choice, and is as many updates old."""
    policy = Policy(spec, SETTINGS)
    state = {name: tensor.clone() for name, tensor in policy.state_dict().items()}
    weight, bias = (
        next(name for name in reversed(state) if name.startswith("actor") and kind in name)
        for kind in ("weight", "bias")
    )
    state[weight].zero_()
    state[bias].copy_(100.0 * torch.eye(NUM_CHOICES)[choice])
    return LeaguePlayer(spec.name, choice, is_newest, None, SETTINGS, state)
