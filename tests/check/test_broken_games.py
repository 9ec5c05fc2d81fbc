"""Every way to be wrong is found, by the check that is there for it; real Godot."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

import pytest

from ludus.check import CheckConfig, CheckContext, Finding, Status
from ludus.check.actions import check_actions
from ludus.check.determinism import check_determinism
from ludus.check.layouts import check_layouts
from ludus.check.observations import check_observations
from ludus.check.resets import check_resets
from ludus.check.seeds import check_seeds
from ludus.check.suite import check_scripts
from ludus.check.timing import check_timing
from ludus.check.vector_env import check_vector_env
from tests.godot_project import AGENT_SCENE, write_project

pytestmark = [pytest.mark.engine, pytest.mark.games]

Checked = Callable[..., list[Finding]]
Check = Callable[[CheckContext], Iterable[Finding]]

CASES: list[tuple[str, Check, Status, str]] = [
    ("global_random", check_seeds, Status.FAIL, "the same seed twice"),
    ("own_random", check_seeds, Status.FAIL, "the same seed twice"),
    ("remembering", check_seeds, Status.WARN, "the same seed twice"),
    ("same_start", check_seeds, Status.WARN, "different seeds"),
    ("meddling", check_seeds, Status.FAIL, "world i of 3 equals"),
    ("process_id", check_determinism, Status.FAIL, "two processes"),
    ("clock", check_timing, Status.FAIL, "the first action acts on what reset returned"),
    ("resets_all", check_timing, Status.FAIL, "a reset of one world"),
    ("forgetful", check_resets, Status.FAIL, "an episode does not depend"),
    ("hidden_leftover", check_resets, Status.WARN, "an episode does not depend"),
    ("out_of_bounds", check_observations, Status.FAIL, "out of bounds"),
    ("constant_entry", check_observations, Status.WARN, "constant elements"),
    ("unscaled", check_observations, Status.WARN, "neither bounded nor near 1"),
    ("pointless", check_observations, Status.WARN, "reward"),
    ("pointless", check_observations, Status.WARN, "episodes end"),
    ("pointless", check_actions, Status.WARN, "actions have an effect"),
    ("closed_mask", check_actions, Status.FAIL, "masks leave a choice"),
    ("global_place", check_layouts, Status.FAIL, "isolated worlds and the grid"),
    ("no_root_2d", check_layouts, Status.INFO, "isolated worlds and the grid"),
]


@pytest.mark.parametrize(
    ("game", "check", "status", "title"), CASES, ids=[f"{case[0]}-{case[3]}" for case in CASES]
)
def test_broken_game_is_caught(
    checked: Checked, game: str, check: Check, status: Status, title: str
) -> None:
    findings = checked(game, check)
    found = [f for f in findings if title in f.title]
    assert found, [f.title for f in findings]
    assert found[-1].status is status, found
    assert found[-1].detail


@pytest.mark.parametrize(
    ("game", "check", "title", "cause"),
    [
        ("global_random", check_vector_env, "one seed for all", "4 draws randf_range(), "),
        ("own_random", check_determinism, "two processes", "5 calls randomize(), "),
        ("unseeded", check_seeds, "the same seed twice", "3 makes a RandomNumberGenerator, "),
        ("shuffling", check_determinism, "two processes", "5 draws shuffle(), "),
        (
            "waiting",
            check_resets,
            "an episode does not depend",
            "7 awaits in _place(), which reset() calls; ",
        ),
        ("waiting", check_seeds, "different seeds", "7 awaits in _place(), which reset() calls; "),
        (
            "reloading",
            check_resets,
            "an episode does not depend",
            "4 calls reload_current_scene(), ",
        ),
    ],
)
def test_likely_cause_is_named_by_script_and_line(
    checked: Checked, game: str, check: Check, title: str, cause: str
) -> None:
    wrong = [f for f in checked(game, check) if f.status in {Status.FAIL, Status.WARN}]
    found = next((f for f in wrong if title in f.title), None)
    assert found, wrong
    assert found.hint.startswith(f"res://{game}.gd:{cause}"), found.hint
    assert all("defect of Ludus" not in f.hint for f in wrong)


GODOT3_GAME = """\
extends Node2D
var x := 0.0

func apply_action(action: int) -> void:
	x += action

func get_observation() -> PoolRealArray:
	return PoolRealArray([x])

func get_reward() -> float:
	return 0.0

func is_done() -> bool:
	return false

func reset() -> void:
	yield(get_tree(), "idle_frame")
	x = rand_range(0.0, 1.0)

func leave() -> void:
	get_tree().change_scene("res://menu.tscn")
"""


def test_likely_causes_are_named_in_godot3(tmp_path: Path) -> None:
    scene = AGENT_SCENE["godot3"].format(script="game", root="Node2D")
    files = {"game.gd": GODOT3_GAME, "game.tscn": scene}
    game = write_project(tmp_path / "game", files, main="game", kind="godot3")
    with CheckContext(CheckConfig(target=game, num_steps=12)) as context:
        (warned,) = check_scripts(context)
        (found, *_) = check_resets(context)
    assert (warned.status, found.status) == (Status.WARN, Status.FAIL)
    assert warned.detail.startswith("res://game.gd:21: calls change_scene(), which cannot work")
    assert "res://game.gd:17 yields in reset(); reset() must be done when it returns" in found.hint
    assert "res://game.gd:18 draws rand_range(), which no seed of the world" in found.hint


def test_first_divergence_names_step_element_and_both_values(checked: Checked) -> None:
    (found,) = checked("process_id", check_determinism)
    assert found.data["step"] == 1
    assert found.data["what"] == 'observation["observation"]'
    assert found.data["element"] == [0]
    assert found.data["tick"] == 2
    one, two = found.data["values"]
    assert one != two
    assert f"{one:.9g}" in found.detail
    assert f"{two:.9g}" in found.detail


def test_divergence_of_seeds_is_in_the_first_observation(checked: Checked) -> None:
    found = next(f for f in checked("own_random", check_seeds) if f.status is Status.FAIL)
    assert (found.data["step"], found.data["element"]) == (0, [0])


def test_constant_element_is_named(checked: Checked) -> None:
    found = next(f for f in checked("constant_entry", check_observations) if "constant" in f.title)
    assert found.data["elements"] == [2]
    assert "0.25" in found.detail


def test_grid_that_plays_otherwise_names_the_first_difference(checked: Checked) -> None:
    found = checked("global_place", check_layouts)[0]
    assert found.data["verdict"] == "different"
    assert found.data["difference"]["step"] == 0
    assert "the first observation" in found.detail


def test_scene_that_cannot_run_in_the_grid_says_why(checked: Checked) -> None:
    (found,) = checked("no_root_2d", check_layouts)
    assert "Node2D or Node3D" in found.detail
