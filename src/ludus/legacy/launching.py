"""The command that starts a bridge's game, and that ends the game when this process is gone."""

from __future__ import annotations

import os
import shlex
import subprocess
from pathlib import Path

from ludus.engine import (
    GodotFlags,
    ensure_imported,
    godot_command,
    with_display,
)
from ludus.errors import TargetError
from ludus.target import Scene, parse_target

__all__ = ["project_command", "shell_command"]

# The game becomes the leader of its process group; the loop beside it ends the group. Its output
# goes nowhere, or the game's would seem to go on when the game has ended.
_LEASH = (
    '(while kill -0 "$0" 2>/dev/null; do sleep 1; done; kill -TERM -$$) '
    '</dev/null >/dev/null 2>&1 & exec "$@"'
)


def project_command(
    target: str | Path, arguments: tuple[str, ...], frames_per_second: int, *, is_windowed: bool
) -> tuple[str, ...]:
    """Return the command that runs a project or a scene.

    Args:
        target: Folder of a Godot project, or a scene of one.
        arguments: What the game itself is told.
        frames_per_second: Frames in one second of game time.
        is_windowed: Whether the game draws.

    Raises:
        TargetError: It is something else, or does not exist.
        EngineNotFound: There is no engine to run it with.
    """
    scene = parse_target(target)
    if not isinstance(scene, Scene):
        raise TargetError(
            f"{target} is no Godot project and no scene",
            hint="name the folder of a project or a .tscn; a line for the shell starts anything "
            "else, such as an exported game",
        )
    engine = scene.find_engine()
    ensure_imported(engine, scene.project)
    flags = GodotFlags(
        headless=not is_windowed,
        fixed_fps=frames_per_second,
        user_args=arguments,
        engine_args=_drawing(is_windowed=is_windowed),
    )
    command = godot_command(engine, scene.project.root, scene.path, flags)
    return _leashed(with_display(command) if is_windowed else command)


def shell_command(
    line: str, arguments: tuple[str, ...], frames_per_second: int, *, is_windowed: bool
) -> tuple[str, ...]:
    """Return the command that has the shell run a line, with our arguments at its end.

    Args:
        line: For the shell of the system.
        arguments: What the game itself is told, behind what the engine is told.
        frames_per_second: Frames in one second of game time.
        is_windowed: Whether the game draws.
    """
    fps = ("--fixed-fps", str(frames_per_second))
    whole = (*fps, *_drawing(is_windowed=is_windowed), *arguments)
    if os.name != "posix":
        return ("cmd", "/s", "/c", f"{line} {subprocess.list2cmdline(whole)}")
    return _leashed(("/bin/sh", "-c", f"{line} {shlex.join(whole)}"))


def _drawing(*, is_windowed: bool) -> tuple[str, ...]:
    return () if is_windowed else ("--disable-render-loop",)


def _leashed(command: tuple[str, ...]) -> tuple[str, ...]:
    """Let a game that does not know us end when this process is gone, however that came.

    Games of legacy bridges wait for the next client for ever.
    """
    if os.name != "posix":
        return command
    return ("/bin/sh", "-c", _LEASH, str(os.getpid()), *command)
