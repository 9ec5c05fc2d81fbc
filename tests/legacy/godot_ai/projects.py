"""A small game for godot-ai as it came from its author, and with our add-on instead of godot-ai."""

from __future__ import annotations

import shutil
from collections import Counter
from pathlib import Path

from ludus.legacy.addon import install_legacy_addon

__all__ = ["GODOT_AI", "Events", "legacy_addon_game", "original_game"]

HERE = Path(__file__).parent
GAME = HERE / "game"
"""The game. Its scripts are the same whatever plays it."""
GODOT_AI = HERE / "original"
"""Stands for godot-ai, whose own code has no licence: speaks its wire, has its class names."""


def original_game(folder: Path) -> Path:
    """Make the project as it came."""
    shutil.copytree(GAME, folder)
    shutil.copytree(GODOT_AI, folder, dirs_exist_ok=True)
    return folder


def legacy_addon_game(folder: Path) -> Path:
    """Make the project, and put our add-on in the place of godot-ai."""
    install_legacy_addon(original_game(folder))
    return folder


class Events:
    """What the game has written down: the words of each line, in order."""

    def __init__(self, log: Path) -> None:
        self.rows = [line.split() for line in log.read_text().splitlines()]

    def of(self, word: str) -> list[list[str]]:
        """Return what follows this word, line by line."""
        return [row[1:] for row in self.rows if row[0] == word]

    def counts(self, word: str) -> Counter[str]:
        """Count the lines of this word for each game."""
        return Counter(row[0] for row in self.of(word))
