"""The command line of a game that runs without a trainer, for people to play or to watch."""

from __future__ import annotations

import os
from dataclasses import replace

from ludus.engine import (
    RUN_SCENE,
    GodotFlags,
    ensure_imported,
    executable_command,
    godot_command,
    require_addon,
)
from ludus.errors import TargetError
from ludus.target import Executable, Scene, Target, prepare

__all__ = ["play_command"]


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
    game = prepare(target)
    if isinstance(game, Executable):
        return executable_command(game.path, flags)
    if not isinstance(game, Scene):
        raise TargetError(
            f"{target.name} is a game that was started by hand",
            hint="name a project, a scene or an exported game",
        )
    root = game.project.root
    require_addon(game.project)
    engine = game.find_engine()
    ensure_imported(engine, game.project)
    own = (f"--ludus-play={game.path}", f"--ludus-parent={os.getpid()}")
    flags = replace(flags, user_args=(*own, *flags.user_args))
    return godot_command(engine, root, RUN_SCENE, flags)
