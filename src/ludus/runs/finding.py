"""Tell whether a path is a run, without loading anything of it."""

from __future__ import annotations

from pathlib import Path

__all__ = ["find_run"]


def find_run(path: Path) -> Path | None:
    """Return the run folder that ``path`` is, or a checkpoint of which it is; None if neither."""
    if not path.is_dir() or (path / "project.godot").is_file():
        return None
    # Resolved only where it must be, so that messages show the path as it was given.
    folders = (path, path.parent.parent, path.resolve().parent.parent)
    return next((folder for folder in folders if (folder / "config.json").is_file()), None)
