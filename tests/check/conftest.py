"""A Godot project of small games: a good one, and one for every way to be wrong."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from ludus.check import CheckConfig, CheckContext, Finding
from tests.check.games import GAMES, scene_text
from tests.godot_project import write_project

Checked = Callable[..., list[Finding]]


@pytest.fixture(scope="session")
def games(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the project; a scene per game, ``<name>.tscn``."""
    files = {f"{name}.gd": game.script for name, game in GAMES.items()}
    files |= {f"{name}.tscn": scene_text(name, game) for name, game in GAMES.items()}
    return write_project(tmp_path_factory.mktemp("games"), files, main="good")


@pytest.fixture
def checked(games: Path) -> Checked:
    """Run one check on a game of the project and return what it found."""

    def run(
        game: str, check: Callable[[CheckContext], list[Finding]], num_steps: int = 60
    ) -> list[Finding]:
        config = CheckConfig(
            target=games / f"{game}.tscn",
            num_worlds=3,
            num_steps=num_steps,
            num_layout_worlds=8,
            timing_s=0.05,
        )
        with CheckContext(config) as context:
            return list(check(context))

    return run
