"""The games that the tests check, as GDScript: a good one and variations that break it."""

from __future__ import annotations

from dataclasses import dataclass

GOOD = """\
extends Node
var world: LudusWorld
var x := 0.0
var v := 0.0

func _ready() -> void:
	world = LudusWorld.of(self)

func _physics_process(_delta: float) -> void:
	x += v

func apply_action(action: int) -> void:
	v += 0.01 if action == 1 else -0.01

func get_observation() -> PackedFloat32Array:
	return PackedFloat32Array([x, v])

func get_reward() -> float:
	return 1.0 - absf(x)

func is_done() -> bool:
	return absf(x) > 1.0

func reset() -> void:
	x = world.rng.randf_range(-0.5, 0.5)
	v = 0.0
"""


@dataclass(frozen=True)
class Game:
    """A script and how its scene is set up."""

    script: str
    root: str = "Node2D"
    is_grid: bool = False
    low: float = -10.0
    high: float = 10.0
    num_elements: int = 2
    is_declared: bool = True
    has_action_mask: bool = False
    max_episode_steps: int = 40
    settle_ticks: int = 0


def broken(body: str) -> str:
    """Return a script that overrides parts of the good game."""
    return f'extends "res://good.gd"\n\n{body}'


GAMES: dict[str, Game] = {
    "good": Game(GOOD),
    "good_grid": Game(broken(""), is_grid=True),
    "settling": Game(broken(""), settle_ticks=3),
    "no_root_2d": Game(broken(""), root="Node"),
    "global_random": Game(
        broken("func reset() -> void:\n\tx = randf_range(-0.5, 0.5)\n\tv = 0.0\n")
    ),
    "own_random": Game(
        broken(
            "func reset() -> void:\n\tvar own := RandomNumberGenerator.new()\n"
            "\town.randomize()\n\tx = own.randf_range(-0.5, 0.5)\n\tv = 0.0\n"
        )
    ),
    "unseeded": Game(
        broken(
            "var dice := RandomNumberGenerator.new()\n\nfunc reset() -> void:\n"
            "\tx = dice.randf_range(-0.5, 0.5)\n\tv = 0.0\n"
        )
    ),
    "shuffling": Game(
        broken(
            "func reset() -> void:\n\tvar places := range(1000)\n\tplaces.shuffle()\n"
            "\tx = places[0] / 2000.0\n\tv = 0.0\n"
        )
    ),
    "waiting": Game(
        broken(
            "func reset() -> void:\n\t_place()\n\nfunc _place() -> void:\n"
            "\tawait get_tree().physics_frame\n\tsuper.reset()\n"
        )
    ),
    "reloading": Game(broken("func reset() -> void:\n\tget_tree().reload_current_scene()\n")),
    "same_start": Game(broken("func reset() -> void:\n\tx = 0.1\n\tv = 0.0\n")),
    "clock": Game(
        broken(
            "func get_observation() -> PackedFloat32Array:\n"
            "\treturn PackedFloat32Array([x, (Time.get_ticks_usec() % 1000000) / 1000000.0])\n"
        )
    ),
    "process_id": Game(
        broken(
            "func _physics_process(_delta: float) -> void:\n"
            "\tx += v + (OS.get_process_id() % 10007) * 1e-7\n"
        )
    ),
    # As Bullet does with turning bodies: what was played before shows in the last digits.
    "remembering": Game(
        broken(
            "static var num_made := 0\n\nfunc _init() -> void:\n\tnum_made += 1\n\n"
            "func _physics_process(_delta: float) -> void:\n\tx += v + num_made * 1e-7\n"
        )
    ),
    "forgetful": Game(broken("func reset() -> void:\n\tx = world.rng.randf_range(-0.5, 0.5)\n")),
    "hidden_leftover": Game(
        broken(
            "var wind := 0.0\n\nfunc apply_action(action: int) -> void:\n"
            "\tsuper(action)\n\twind += 0.01\n\n"
            "func _physics_process(_delta: float) -> void:\n\tx += v + wind\n"
        )
    ),
    "out_of_bounds": Game(broken(""), low=-0.6, high=0.6),
    "constant_entry": Game(
        broken(
            "func get_observation() -> PackedFloat32Array:\n"
            "\treturn PackedFloat32Array([x, v, 0.25])\n"
        ),
        num_elements=3,
    ),
    "unscaled": Game(
        broken(
            "func get_observation() -> PackedFloat32Array:\n"
            "\treturn PackedFloat32Array([x * 1000.0, v])\n"
        ),
        is_declared=False,
    ),
    "pointless": Game(
        broken(
            "func apply_action(_action: int) -> void:\n\tpass\n\n"
            "func get_reward() -> float:\n\treturn 0.0\n\n"
            "func is_done() -> bool:\n\treturn false\n"
        ),
        max_episode_steps=0,
    ),
    "global_place": Game(
        broken(
            "func get_observation() -> PackedFloat32Array:\n"
            '\tvar place: Vector2 = get(&"global_position")\n'
            "\treturn PackedFloat32Array([place.x + x, v])\n"
        ),
        is_grid=True,
        low=-10000.0,
        high=10000.0,
    ),
    "meddling": Game(
        broken(
            "static var total := 0.0\n\nfunc _enter_tree() -> void:\n\ttotal += 0.001\n\n"
            "func _exit_tree() -> void:\n\ttotal -= 0.001\n\n"
            "func _physics_process(_delta: float) -> void:\n\tx += v + total\n"
        )
    ),
    "resets_all": Game(
        broken(
            'func _enter_tree() -> void:\n\tadd_to_group(&"players")\n\n'
            "func reset() -> void:\n\tsuper()\n"
            '\tfor other: Node in get_tree().get_nodes_in_group(&"players"):\n'
            "\t\tother.v = 0.0\n\t\tother.x *= 0.5\n"
        )
    ),
    "closed_mask": Game(
        broken(
            "func get_action_mask() -> PackedByteArray:\n"
            "\treturn PackedByteArray([1, 1]) if absf(x) < 0.5 else PackedByteArray([0, 0])\n"
        ),
        has_action_mask=True,
    ),
    "masked": Game(
        broken(
            "var may_push := true\n\nfunc apply_action(action: int) -> void:\n"
            "\tassert(action == 0 or may_push)\n\tsuper(action)\n\n"
            "func get_action_mask() -> PackedByteArray:\n"
            "\tmay_push = x < 0.4\n\treturn PackedByteArray([1, int(may_push)])\n"
        ),
        has_action_mask=True,
    ),
    "masked_own_random": Game(
        broken(
            "func reset() -> void:\n\tv = 0.0\n\tvar own := RandomNumberGenerator.new()\n"
            "\town.randomize()\n\tx = own.randf_range(-0.5, 0.5)\n\n"
            "func get_action_mask() -> PackedByteArray:\n\treturn PackedByteArray([1, 1])\n"
        ),
        has_action_mask=True,
    ),
    "not_a_number": Game(
        broken(
            "func get_observation() -> PackedFloat32Array:\n"
            "\treturn PackedFloat32Array([x, NAN if absf(x) > 0.6 else v])\n"
        )
    ),
}

_SCENE = """\
[gd_scene format=3]

[ext_resource type="Script" path="res://{name}.gd" id="1"]
[ext_resource type="Script" path="res://addons/ludus/agent/ludus_agent.gd" id="2"]
[ext_resource type="Script" path="res://addons/ludus/agent/ludus_action_component.gd" id="3"]
[ext_resource type="Script" path="res://addons/ludus/world/ludus_world.gd" id="4"]
[ext_resource type="Script" path="res://addons/ludus/agent/ludus_observation_entry.gd" id="5"]

[sub_resource type="Resource" id="push"]
script = ExtResource("3")
name = "push"

[sub_resource type="Resource" id="entry"]
script = ExtResource("5")
shape = PackedInt32Array({num_elements})
low = {low}
high = {high}

[node name="Game" type="{root}"]
script = ExtResource("1")

[node name="LudusAgent" type="Node" parent="."]
script = ExtResource("2")
policy_name = "player"
action = Array[ExtResource("3")]([SubResource("push")])
max_episode_steps = {max_episode_steps}
has_action_mask = {has_action_mask}
{observation}
[node name="LudusWorld" type="Node" parent="."]
script = ExtResource("4")
layout = {layout}
settle_ticks = {settle_ticks}
spacing = Vector3(100, 100, 0)
"""


def scene_text(name: str, game: Game) -> str:
    """Return the ``.tscn`` of a game."""
    entries = 'observation = Array[ExtResource("5")]([SubResource("entry")])\n'
    return _SCENE.format(
        name=name,
        root=game.root,
        num_elements=game.num_elements,
        low=game.low,
        high=game.high,
        max_episode_steps=game.max_episode_steps,
        has_action_mask="true" if game.has_action_mask else "false",
        observation=entries if game.is_declared else "",
        layout=int(game.is_grid),
        settle_ticks=game.settle_ticks,
    )
