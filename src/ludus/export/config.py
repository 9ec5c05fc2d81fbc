"""What to export, and where to: everything that ``ludus export`` can be told."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

__all__ = ["ExportConfig"]


@dataclass(frozen=True, kw_only=True)
class ExportConfig:
    """What to export, and where to.

    Attributes:
        run: Run folder, or one of its checkpoints; or a model of Stable-Baselines3 (.zip), a
            policy of Godot RL Agents (.onnx), or a checkpoint of godot-ai (.pt).
        policy: Export only this policy; all if not given.
        to: A file, if there is one policy; a folder; or a pattern such as models/{policy}.onnx.
            If not given, .ludus.json files in the run's folder.
        checkpoint: "newest", "best" (the highest mean return), or one of the run's checkpoints.
        is_tested: Test that every runtime computes what was trained, the game engine included.
        godot: Godot to test with; if not given, the run's, or the one that ludus finds. A run in a
            Bevy game is tested with that game.
        game: What a model of Stable-Baselines3 or Godot RL Agents was trained in, which its file
            does not tell.
    """

    run: Path
    policy: str | None = None
    to: str | None = None
    checkpoint: str = "newest"
    is_tested: bool = True
    godot: Path | None = None
    game: str | None = None
