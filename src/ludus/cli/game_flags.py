"""How the game of a run is opened once more: flags of the commands that take a run."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from ludus.settings.pool_config import Layout

__all__ = ["GameFlags"]


@dataclass(frozen=True, kw_only=True)
class GameFlags:
    """Each is as in training unless given.

    Attributes:
        target: Play in this target; none is the one the run was trained in.
        scene: Scene of the project; none is the one that was trained.
        num_worlds: Worlds in each engine; none is as many as in training.
        num_engines: Game processes side by side; none is as many as in training.
        layout: How worlds are kept apart; none is as in training.
        ticks_per_step: Physics ticks per decision; none is as in training.
        max_episode_steps: Steps after which episodes are truncated; none is as in training.
        godot: Engine to use; none is as in training.
        is_pinned: Give each engine a core of its own, as in training; without it none gets one.
        token_file: File with the token of a game on another machine; none is as in training.
    """

    target: str | None = None
    scene: str | None = None
    num_worlds: int | None = None
    num_engines: int | None = None
    layout: Layout | None = None
    ticks_per_step: int | None = None
    max_episode_steps: int | None = None
    godot: Path | None = None
    is_pinned: bool = True
    token_file: Path | None = None

    def given(self) -> dict[str, Any]:
        """Return the settings that were given."""
        values = {part.name: getattr(self, part.name) for part in fields(GameFlags)}
        usual = {part.name: part.default for part in fields(GameFlags)}
        return {name: value for name, value in values.items() if value != usual[name]}
