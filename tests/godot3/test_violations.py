"""What Godot 3 does with a trainer that breaks the rules: the tests of Godot 4, on Godot 3."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from ludus.engine import InstalledEngine
from tests.godot.conftest import Game
from tests.godot.test_violations import (
    Trainer,
    test_a_spec_instead_of_a_welcome,
    test_a_trainer_that_is_silent_for_too_long,
    test_a_trainer_that_leaves_ends_the_game,
    test_a_violation_is_answered_and_ends_the_game,
    test_a_welcome_that_does_not_fit,
    test_the_rules_can_be_kept,
)

__all__ = [
    "test_a_spec_instead_of_a_welcome",
    "test_a_trainer_that_is_silent_for_too_long",
    "test_a_trainer_that_leaves_ends_the_game",
    "test_a_violation_is_answered_and_ends_the_game",
    "test_a_welcome_that_does_not_fit",
    "test_the_rules_can_be_kept",
]

pytestmark = pytest.mark.engine


@pytest.fixture
def trainer(game: Game, godot3: InstalledEngine) -> Iterator[Trainer]:
    made = Trainer(game, godot3)
    yield made
    made.close()
