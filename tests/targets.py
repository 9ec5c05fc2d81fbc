"""The game, the project or the program that a word means, ready to be opened."""

from __future__ import annotations

from pathlib import Path

from ludus.target import Address, Executable, Game, Play, Scene, parse_target, prepare

__all__ = ["find_executable", "find_game", "find_scene"]


def find_game(target: str | Path, scene: str | None = None) -> Game:
    """Return what a session can be opened with."""
    game = prepare(parse_target(target, scene=scene))
    assert isinstance(game, Scene | Executable | Address | Play)
    return game


def find_scene(target: str | Path, scene: str | None = None) -> Scene:
    """Return the scene of a project."""
    game = find_game(target, scene)
    assert isinstance(game, Scene)
    return game


def find_executable(target: str | Path) -> Path:
    """Return the program."""
    game = find_game(target)
    assert isinstance(game, Executable)
    return game.path
