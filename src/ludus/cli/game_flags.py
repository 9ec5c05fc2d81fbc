"""How the game of a run is opened once more: flags of the commands that take a run."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from ludus.cli.bridge_flags import BridgeFlags
from ludus.settings.pool_config import Layout

__all__ = ["GameFlags"]


@dataclass(frozen=True, kw_only=True)
class GameFlags(BridgeFlags):
    """Each is as in training unless given.

    Attributes:
        target: Target to play in; the run's own if not given.
        scene: Scene of the project; the one that was trained if not given.
        num_worlds: Worlds in each engine; as in training if not given.
        num_engines: Game processes side by side; as in training if not given.
        layout: How worlds are kept apart; as in training if not given.
        ticks_per_step: Physics ticks per decision; if not given, the run's setting, or else the
            agents' own.
        max_episode_steps: Steps after which episodes are truncated; if not given, the run's
            setting, or else the agents' own.
        godot: Engine to use; as in training if not given.
        is_pinned: Give each engine its own core, as in training if not given; without it none gets
            one.
        token_file: File with the token of a game on another machine; as in training if not given.
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
        usual = GameFlags()
        values = {part.name: getattr(self, part.name) for part in fields(GameFlags)}
        return {name: value for name, value in values.items() if value != getattr(usual, name)}
