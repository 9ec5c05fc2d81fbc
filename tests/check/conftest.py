"""A Godot project of small games: a good one, and one for every way to be wrong."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from ludus.check import CheckConfig, CheckContext, Finding
from ludus.engine.bundled import bundled_root
from tests.check.games import GAMES, PROJECT, scene_text

Checked = Callable[..., list[Finding]]


@pytest.fixture(scope="session")
def games(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the project; a scene per game, ``<name>.tscn``."""
    root = tmp_path_factory.mktemp("games")
    (root / "project.godot").write_text(PROJECT)
    # Through a link, the import would write into the add-on that other tests use meanwhile.
    shutil.copytree(bundled_root() / "addons/ludus", root / "addons/ludus")
    for name, game in GAMES.items():
        (root / f"{name}.gd").write_text(game.script)
        (root / f"{name}.tscn").write_text(scene_text(name, game))
    return root


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
