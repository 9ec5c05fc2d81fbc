"""The command line of a game that runs without a trainer, for people to play or to watch."""

from __future__ import annotations

import os
from dataclasses import replace

from ludus.engine import (
    GodotFlags,
    Target,
    ensure_imported,
    executable_command,
    godot_command,
)
from ludus.errors import TargetError

__all__ = ["play_command"]

RUN_SCENE = "res://addons/ludus/run.tscn"


def play_command(target: Target, flags: GodotFlags) -> tuple[str, ...]:
    """Return the command line that shows a target.

    A project's scene is started by the add-on, which works without its autoload, too.

    Args:
        target: What to show.
        flags: Window, pace and arguments for the game.

    Raises:
        TargetError: It cannot be started, or has no Ludus add-on.
        EngineNotFound: There is no engine to run it with.
    """
    if target.executable is not None:
        return executable_command(target.executable, flags)
    engine = target.find_engine()
    if engine is None or target.project is None:
        raise TargetError(
            f"{target.name} is a game that was started by hand",
            hint="name a project, a scene or an exported game",
        )
    if not (target.project.root / "addons/ludus/run.tscn").is_file():
        raise TargetError(
            f"{target.project.root} has no Ludus add-on",
            hint=f"run `ludus addon install {target.project.root}`",
        )
    ensure_imported(engine, target.project)
    own = (f"--ludus-play={target.scene}", f"--ludus-parent={os.getpid()}")
    flags = replace(flags, user_args=(*own, *flags.user_args))
    return godot_command(engine, target.project.root, RUN_SCENE, flags)
