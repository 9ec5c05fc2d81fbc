"""What newcomers run into, on real Godot 4: it works, or an error names cause and remedy."""

from __future__ import annotations

import contextlib
import logging
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

import ludus
from ludus.check import CheckConfig, CheckContext, Status
from ludus.check.suite import check_scripts
from ludus.settings.train_config import PPOConfig, TrainConfig
from ludus.training.loop import train
from tests.godot_project import AGENT_SCENE, write_project

pytestmark = pytest.mark.engine

DOCS = Path(__file__).parents[2] / "docs"

GAME = """\
extends {root}
var x := 0.0

func apply_action(action: int) -> void:
	x = float(action)

func get_observation() -> PackedFloat32Array:
	return PackedFloat32Array([x])

func get_reward():
	return x

func is_done():
	return false

func reset() -> void:
	x = 0.0
"""
MASK = """
func get_action_mask() -> PackedByteArray:
	return PackedByteArray([1, 0])
"""

MakeGame = Callable[..., Path]


@pytest.fixture
def make_game(tmp_path: Path) -> MakeGame:
    """Write a game whose script is :data:`GAME` with replacements and additions."""

    def make(more: str = "", root: str = "Node", **replaced: str) -> Path:
        script = GAME.format(root=root)
        for old, new in replaced.items():
            assert f"func {old}(" in script
            script = script.replace(f"func {old}(", new + f"\n\nfunc _unused_{old}(")
        scene = AGENT_SCENE["godot4"].format(script="game", root=root)
        scene = scene.replace("action = ", "max_episode_steps = 8\naction = ")
        files = {"game.gd": script + more, "game.tscn": scene}
        return write_project(tmp_path / "game", files, main="game")

    return make


def short_training(game: Path, runs: Path) -> TrainConfig:
    return TrainConfig(
        target=str(game), num_worlds=2, num_engines=1, total_steps=64, seed=7, runs=runs,
        name="run", evaluation_episodes=0, ppo=PPOConfig(rollout_steps=8, hidden_sizes=(8,)),
    )  # fmt: skip


def test_an_action_mask_is_found_by_itself(make_game: MakeGame) -> None:
    with contextlib.closing(ludus.make_vec(str(make_game(MASK)), num_worlds=2)) as env:
        _, infos = env.reset(seed=1)
        assert infos["action_mask"].tolist() == [[True, False]] * 2


def test_a_run_that_began_without_masks_goes_on_and_plays(
    make_game: MakeGame, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    config = short_training(make_game(), tmp_path / "runs")
    run = train(config)
    make_game(MASK)
    with caplog.at_level(logging.WARNING, "ludus"):
        resumed = train(replace(config, total_steps=128), resume=run.path)
    assert resumed.agent_steps == 128
    assert caplog.text.count("was trained without the game's action masks") == 1
    played = ludus.evaluate(run.path, episodes=2)
    # The mask forbids the action that gives a reward.
    assert played["agent"].mean_return == 0.0


def test_the_scene_of_the_docs_plays_with_the_sensors_of_the_docs(make_game: MakeGame) -> None:
    def block(page: str, heading: str) -> str:
        return (DOCS / page).read_text().split(heading)[1].split("```")[1].partition("\n")[2]

    scripts, sensors = block("sensors.md", "## As text").split("\n\n", 1)
    scene = block("godot.md", "## The scene as text")
    scene = scene.replace("[sub_resource", f"{scripts}\n\n[sub_resource", 1).replace(
        "player.gd", "game.gd"
    )
    flag = '[node name="Flag" type="Node2D" parent="."]\nposition = Vector2(100, 0)\n'
    game = make_game(root="CharacterBody2D")
    (game / "game.tscn").write_text(f"{scene}\n{sensors}\n{flag}")
    with contextlib.closing(ludus.make_vec(str(game), num_worlds=2)) as env:
        seen, _ = env.reset(seed=1)
    assert {name: entry.shape for name, entry in seen.items()} == {
        "observation": (2, 1), "Coins": (2, 5), "Goal": (2, 4)
    }  # fmt: skip
    assert seen["Goal"].tolist() == [[pytest.approx(0.1), 0.0, 0.0, 0.0]] * 2


WRONG_METHODS = {
    "no return": (
        "get_reward",
        "func get_reward():\n\tpass",
        "get_reward(): expected a number, got nothing",
    ),
    "a text": (
        "get_reward",
        'func get_reward():\n\treturn "1"',
        "get_reward(): expected a number, got String",
    ),
    "no flag": (
        "is_done",
        "func is_done():\n\tpass",
        "is_done(): expected true or false, got nothing",
    ),
    "a vector": (
        "is_done",
        "func is_done():\n\treturn Vector2.ZERO",
        "is_done(): expected true or false, got Vector2",
    ),
}


@pytest.mark.parametrize("case", WRONG_METHODS)
def test_a_wrong_type_names_script_and_method(make_game: MakeGame, case: str) -> None:
    method, code, message = WRONG_METHODS[case]
    with contextlib.closing(ludus.make(str(make_game(**{method: code})))) as env:
        env.reset(seed=1)
        with pytest.raises(
            ludus.LudusError, match=re.escape(f"(res://game.gd), step 1: {message}")
        ):
            env.step(0)


def test_a_reset_that_waits_is_refused(make_game: MakeGame) -> None:
    waits = "func reset() -> void:\n\tx = 0.0\n\tawait get_tree().process_frame"
    with pytest.raises(ludus.LudusError, match=r"res://game.gd:\d+: reset\(\) must not wait"):
        ludus.make(str(make_game(reset=waits)))


@pytest.mark.parametrize(("method", "written"), [("reset", "resets"), ("is_done", "is_doen")])
def test_a_misspelt_method_is_guessed(make_game: MakeGame, method: str, written: str) -> None:
    script = make_game() / "game.gd"
    script.write_text(script.read_text().replace(f"{method}()", f"{written}()"))
    said = rf"no method {method}\(\); did you misspell it as {written}\(\)"
    with pytest.raises(ludus.LudusError, match=said):
        ludus.make(str(script.parent))


@pytest.mark.parametrize(
    ("code", "warning"),
    [
        (
            "func is_truncate():\n\treturn false\n",
            "is_truncate() is never called; did you mean is_truncated()?",
        ),
        ("func get_action_masks():\n\treturn []\n", "did you mean get_action_mask()?"),
        (
            "func die():\n\tget_tree().reload_current_scene()\n",
            "reload_current_scene() does nothing",
        ),
        (
            'func die():\n\tget_tree().change_scene_to_file("res://a.tscn")\n',
            "change_scene_to_file() does nothing",
        ),
    ],
)
def test_doubts_about_scripts_are_told_by_check_and_training(
    make_game: MakeGame, tmp_path: Path, caplog: pytest.LogCaptureFixture, code: str, warning: str
) -> None:
    game = make_game(f"\n{code}")
    with CheckContext(CheckConfig(target=game, num_worlds=1, num_steps=5)) as context:
        (found,) = check_scripts(context)
    assert (found.status, warning in found.detail) == (Status.WARN, True), found
    assert "res://game.gd" in found.detail
    with caplog.at_level(logging.WARNING, "ludus"):
        train(short_training(game, tmp_path / "runs"))
    assert warning in caplog.text


def test_repeated_errors_of_the_game_are_summed_up(
    make_game: MakeGame, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    fails = "func is_done():\n\tget_tree().reload_current_scene()\n\treturn false"
    with caplog.at_level(logging.WARNING, "ludus"):
        train(short_training(make_game(is_done=fails), tmp_path / "runs"))
    found = re.search(r"the game printed (\d+) × (.*)", caplog.text)
    assert found is not None, caplog.text
    assert int(found[1]) == 64, found
    assert 'Parameter "current_scene" is null' in found[2]
    assert "(res://game.gd:" in found[2]


def test_engines_that_declare_other_games_say_what_differs(make_game: MakeGame) -> None:
    odd = (
        "func get_observation():\n\tvar seen := PackedFloat32Array([x])\n"
        "\tseen.resize(1 + mini(LudusWorld.of(self).index, 1))\n\treturn seen"
    )
    game = make_game(get_observation=odd)
    with pytest.raises(ludus.LudusError, match=r"shape\[0\] is 2 instead of 1"):
        ludus.make_vec(str(game), num_worlds=1, num_engines=2)


ROOM = """\
[node name="Room" type="StaticBody2D" parent="."]
[node name="Left" type="CollisionShape2D" parent="Room"]
position = Vector2(-2400, 0)
shape = SubResource("wall")
[node name="Right" type="CollisionShape2D" parent="Room"]
position = Vector2(2400, 0)
shape = SubResource("wall")
[node name="World" type="Node" parent="."]
script = ExtResource("4")
layout = 1
"""


@pytest.mark.parametrize("spacing", ["Vector3(100, 0, 100)", ""])
def test_copies_do_not_lie_in_each_other(make_game: MakeGame, spacing: str) -> None:
    game = make_game(
        root="Node2D",
        get_observation='func get_observation():\n\tvar place: float = get(&"position").x\n'
        "\treturn PackedFloat32Array([place])",
    )
    scene = game / "game.tscn"
    text = scene.read_text().replace(
        "[sub_resource",
        '[ext_resource path="res://addons/ludus/world/ludus_world.gd" type="Script" id="4"]\n'
        '[sub_resource type="RectangleShape2D" id="wall"]\nsize = Vector2(20, 20)\n[sub_resource',
        1,
    )
    scene.write_text(text + ROOM + (f"spacing = {spacing}\n" if spacing else ""))
    if spacing:
        with pytest.raises(ludus.LudusError, match=r"4820 × 20 pixels.*set it to \(8192"):
            ludus.make_vec(str(game), num_worlds=2)
        return
    with contextlib.closing(ludus.make_vec(str(game), num_worlds=2)) as env:
        places = env.reset(seed=1)[0]
    assert abs(places[1] - places[0]).item() == 8192.0


def test_a_game_may_have_classes_with_the_names_of_our_types(make_game: MakeGame) -> None:
    """Godot looks for a type among the game's global classes before it looks in our script."""
    count_broken = """func get_observation() -> PackedFloat32Array:
	var num_broken := 0
	for path in FileAccess.get_file_as_string("res://scripts.txt").split("\\n"):
		var script := load(path) as GDScript
		num_broken += int(script == null or not script.can_instantiate())
	return PackedFloat32Array([num_broken])
"""
    game = make_game(get_observation=count_broken)
    addon = game / "addons/ludus"
    scripts = [path for path in addon.rglob("*.gd") if "editor" not in path.parts]
    listed = (f"res://{path.relative_to(game).as_posix()}" for path in scripts)
    (game / "scripts.txt").write_text("\n".join(listed))
    types = re.compile(r"^(?:enum|class) ((?!Ludus)\w+)", re.MULTILINE)
    names = {name for path in addon.rglob("*.gd") for name in types.findall(path.read_text())}
    assert "State" in names
    for name in names:
        (game / f"{name}.gd").write_text(f"class_name {name}\nextends Node\n")
    with contextlib.closing(ludus.make(str(game))) as env:
        observation, _ = env.reset(seed=1)
    assert observation.tolist() == [0.0]
