"""Every bundled game passes ``ludus check`` without a warning; real Godot."""

from __future__ import annotations

import pytest

from ludus.check import CheckConfig, Status, run_checks
from ludus.engine.bundled import example_names

pytestmark = [pytest.mark.engine, pytest.mark.games]

# Scenes with known answers, which are no games: what they observe may well be constant.
NO_GAMES = {"identity"}
# By chance, agents meet only now and then, and an apple is seen from few sides.
NUM_WORLDS = {"apple_seeker": 16, "find_coin": 16, "godot3:apple_seeker": 16, "zombies": 16}
GAMES = sorted(set(example_names()) - NO_GAMES)
WITHOUT_PHYSICS = {"find_coin", "key_door", "tag", "zombies"}


def test_the_games_are_found() -> None:
    assert {"ball_chase", "cartpole", "key_door", "pendulum", "tag"} <= set(GAMES)
    assert set(NUM_WORLDS) | WITHOUT_PHYSICS <= set(GAMES)


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
    if game in WITHOUT_PHYSICS:
        [layouts] = [f for _, f in report.findings if "verdict" in f.data]
        assert layouts.data["verdict"] == "equal to the bit"
