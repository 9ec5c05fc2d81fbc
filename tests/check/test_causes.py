"""Which lines of scripts are named as likely causes, and which are not; no engine."""

from __future__ import annotations

from pathlib import Path

import pytest

from ludus.check.causes import name_causes, scene_changes
from ludus.check.scripts import Script, find_scripts, functions_of_reset

RNG = "LudusWorld.of(self).rng"


def hint(*texts: str, has_casts: bool = False) -> str:
    scripts = tuple(
        Script(f"res://{name}.gd", text) for name, text in zip("ab", texts, strict=False)
    )
    return name_causes(scripts, "unknown", has_casts=has_casts)


@pytest.mark.parametrize(
    ("line", "cause"),
    [
        ("x = randf()", f"draws randf(), which no seed of the world reaches: use {RNG}.randf()"),
        ("x = 2 * randi() % 3", f"use {RNG}.randi()"),
        ("x = clampf(randf_range(\n\t\t0, 1), 0, 1)", f"use {RNG}.randf_range()"),
        ("x = randi_range(0, 1)", f"use {RNG}.randi_range()"),
        ("x = randfn(0, 1)", f"use {RNG}.randfn()"),
        (
            "x = rand_range(0, 1)",
            f"draws rand_range(), which no seed of the world reaches: use {RNG}.randf_range()",
        ),
        ("x = [1, 2].pick_random()", f"take element {RNG}.randi() % size()"),
        ("cards.shuffle()", "swap each element i"),
        ("randomize()", "calls randomize(), which seeds from the clock"),
        ("dice.randomize()", "calls randomize(), which seeds from the clock"),
        ("var dice := RandomNumberGenerator.new()", "makes a RandomNumberGenerator"),
        ("roll(RandomNumberGenerator.new())", "makes a RandomNumberGenerator"),
        (
            "var dice = RandomNumberGenerator.new()\n\tdice.seed = 4",
            "makes a RandomNumberGenerator",
        ),
        ("get_tree().reload_current_scene()", "calls reload_current_scene(), which cannot work"),
        ('get_tree().change_scene("res://b.tscn")', "calls change_scene(), which cannot work"),
        ("tree.change_scene_to_file.call_deferred(x)", "calls change_scene_to_file()"),
    ],
)
def test_line_is_named(line: str, cause: str) -> None:
    named = hint(f"extends Node\n\nfunc _ready():\n\tvar x\n\t{line}\n")
    assert named.startswith("res://a.gd:5 "), named
    assert cause in named
    assert named.endswith(". Otherwise: unknown")


@pytest.mark.parametrize(
    "text",
    [
        "func act():\n\tx = world.rng.randf() + rng.randi_range(0, 3)\n",
        "func act():\n\tx = LudusWorld.of(self).rng.randf()\n",
        "# randf()\nfunc act():\n\tpass # randomize()\n",
        "func act():\n\tprint(\"# randf()\", 'randi()')\n",
        'var text = """\nrandf()\n" randi() # \n"""\n',
        "func shuffle():\n\tpass\n\nfunc act():\n\tself.shuffle()\n",
        "func randf():\n\treturn 4\n\nfunc act():\n\tx = randf()\n",
        "func act():\n\tmy_randf()\n\tshuffle_cards()\n\tx = randf_table(2)\n",
        "var dice := RandomNumberGenerator.new()\n\nfunc reset():\n\tdice.seed = 4\n",
        "var dice = RandomNumberGenerator.new()\n\nfunc reset():\n\tbegin(3)\n\n"
        "func begin(x):\n\tdice.set_seed(x)\n",
        "var d := RandomNumberGenerator.new()\n\nfunc deal():\n\td.seed = world.rng.randi()\n",
        "func die():\n\tawait get_tree().create_timer(1.0).timeout\n\nfunc reset():\n\tpass\n",
        "func reset():\n\tpass\n\nvar hp: int:\n\tset(value):\n\t\tawait act()\n",
        "func act():\n\tmanager.change_scene(3)\n",
    ],
)
def test_line_is_not_named(text: str) -> None:
    assert hint(text) == "unknown"


@pytest.mark.parametrize(
    ("reset", "cause"),
    [
        ("\tawait get_tree().process_frame", "awaits in reset(); reset() must be done"),
        ('\tyield(get_tree(), "idle_frame")', "yields in reset(); reset() must be done"),
        ("\tpass; await x", "awaits in reset(); reset() must be done"),
    ],
)
def test_reset_that_waits_is_named(reset: str, cause: str) -> None:
    named = hint(f"extends Node\n\nfunc reset():\n\t# await\n\n{reset}\n")
    assert named.startswith(f"res://a.gd:6 {cause}"), named


def test_wait_is_named_in_what_reset_calls_in_another_script() -> None:
    waits = "class Inner:\n\tfunc place():\n\t\tx = 0\n\t\tawait y\n\tfunc rest():\n\t\tawait z\n"
    named = hint("func reset():\n\tbegin()\n\nfunc begin():\n\tboss.place()\n", waits)
    assert named.startswith("res://b.gd:4 awaits in place(), which reset() calls; "), named
    assert "b.gd:6" not in named


def test_generator_is_seeded_by_another_script() -> None:
    dice = "var dice := RandomNumberGenerator.new()\n"
    assert "makes a Random" in hint(dice, "func reset():\n\tx.dice.state == 3\n")
    assert hint(dice, "func reset():\n\tx.dice.state = 3\n") == "unknown"


def test_places_of_one_cause_are_listed_once_and_not_endlessly() -> None:
    named = hint("func act():\n" + "\tx = randf()\n" * 2)
    assert named.startswith("res://a.gd:2 (also res://a.gd:3) draws randf(), ")
    named = hint("func act():\n" + "\tx = randf()\n" * 9)
    others = ", ".join(f"res://a.gd:{line}" for line in (3, 4, 5))
    assert named.startswith(f"res://a.gd:2 (also {others}, …) draws randf(), ")


def test_looks_into_the_physics_space_are_named_where_they_matter() -> None:
    text = "func act():\n\tray.force_raycast_update()\n"
    assert hint(text) == "unknown"
    assert hint(text, has_casts=True).startswith("res://a.gd:2 looks into the physics space")


def test_functions_of_reset_are_found_through_calls() -> None:
    text = (
        "func reset() -> void: begin(Vector2(0, 0))\n"
        "static func begin(\n\t\tat = Vector2(1, 2), by = 3) -> void:\n\tother.reset()\n\tend()\n"
        "func end():\n\tbegin()\nfunc alone():\n\tend()\n"
    )
    found = functions_of_reset([Script("res://a.gd", text)])
    assert [function.name for _, function in found] == ["reset", "begin", "end"]


FILES = {
    "project.godot": '[autoload]\nGlobal="*res://global.gd"\nIdle="*res://idle.gd"\n',
    "game.tscn": '[ext_resource type="Script" uid="uid://1" path="res://a/game.gd" id="1"]\n'
    '[ext_resource path="res://a/boss.tscn" type="PackedScene" id=2]\n'
    '[ext_resource path="res://addons/ludus/world/ludus_world.gd" type="Script" id=3]\n'
    '[ext_resource path="res://missing.gd" type="Script" id=4]\n',
    "a/boss.tscn": '[ext_resource path="res://a/boss.gd" type="Script" id=1]\n'
    '[ext_resource path="res://a/boss.tres" type="Resource" id=2]\n',
    "a/boss.tres": '[ext_resource path="res://data.gd" type="Script" id=1]\n',
    "a/boss.gd": 'extends "../base.gd"\n',
    "a/game.gd": 'extends Hero\nconst SHOT = preload("shot.tscn")\n# preload("../comment.gd")\n'
    'func act():\n\tGlobal.roll()\n\tget_tree().change_scene_to_file("res://menu.tscn")\n',
    "a/shot.tscn": '[ext_resource path="res://shot.gd" type="Script" id=1]\n',
    "menu.tscn": '[ext_resource path="res://menu.gd" type="Script" id=1]\n',
    "hero.gd": '@icon("hero.svg") class_name Hero extends Node\n',
    "addons/ludus/world/ludus_world.gd": "class_name LudusWorld\nfunc act():\n\trandf()\n",
    **dict.fromkeys(
        ("base.gd", "shot.gd", "data.gd", "global.gd", "idle.gd", "menu.gd", "comment.gd"),
        "extends Node\n",
    ),
}


def test_scripts_of_a_scene_are_those_that_it_names(tmp_path: Path) -> None:
    for name, text in FILES.items():
        file = tmp_path / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    found = {script.path for script in find_scripts(tmp_path, "res://game.tscn")}
    assert found == {
        f"res://{name}.gd"
        for name in ("a/game", "a/boss", "base", "hero", "shot", "data", "global")
    }


def test_scene_changes_say_what_to_do_instead() -> None:
    script = Script("res://a.gd", "func die():\n\tget_tree().reload_current_scene()\n")
    ((place, text),) = scene_changes((script,))
    assert place == "res://a.gd:2"
    assert "let is_done() return true, and put everything back in reset()" in text
