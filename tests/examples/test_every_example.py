"""Every bundled game passes ``ludus check`` without a warning; real Godot."""

from __future__ import annotations

import pytest

from ludus.check import CheckConfig, CheckContext, Status, run_checks
from ludus.check.layouts import check_layouts
from ludus.engine.bundled import example_names

pytestmark = pytest.mark.engine

# Scenes with known answers, which are no games: what they observe may well be constant.
NO_GAMES = {"identity"}
# By chance, agents meet only now and then, and an apple is seen from few sides.
NUM_WORLDS = {"find_coin": 16, "godot3:apple_seeker": 16, "zombies": 16}
GAMES = sorted(set(example_names()) - NO_GAMES)


def test_the_games_are_found() -> None:
    assert {"ball_chase", "cartpole", "key_door", "pendulum", "tag"} <= set(GAMES)
    assert set(NUM_WORLDS) <= set(GAMES)


@pytest.mark.parametrize("game", GAMES)
def test_nothing_fails_and_nothing_is_warned_of(game: str) -> None:
    # 301 steps see the end of the longest episode.
    config = CheckConfig(
        target=game,
        num_worlds=NUM_WORLDS.get(game, 2),
        num_steps=301,
        num_layout_worlds=8,
        timing_s=0.05,
    )
    report = run_checks(config)
    wrong = [f for _, f in report.findings if f.status in {Status.FAIL, Status.WARN}]
    assert wrong == []


@pytest.mark.parametrize("game", ["find_coin", "key_door", "tag", "zombies"])
def test_games_without_physics_are_equal_to_the_bit_in_both_layouts(game: str) -> None:
    config = CheckConfig(
        target=game, num_worlds=2, num_steps=60, num_layout_worlds=16, timing_s=0.05
    )
    with CheckContext(config) as context:
        verdict, _speed = check_layouts(context)
    assert verdict.data["verdict"] == "equal to the bit"
