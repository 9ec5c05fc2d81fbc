"""What to start and how: the command line of a game, and everything around it."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from ludus.engine.bevy_game import bevy_command, is_bevy_game
from ludus.engine.exported import exported_with
from ludus.engine.find import InstalledEngine
from ludus.engine.kinds import EngineKind
from ludus.engine.screen import find_xvfb, has_screen, with_display

__all__ = ["GodotFlags", "LaunchConfig", "executable_command", "godot_command"]

DEFAULT_FIXED_FPS = 60


@dataclass(frozen=True, kw_only=True)
class LaunchConfig:
    """A process to start and supervise.

    Attributes:
        command: Program and arguments.
        folder: Working folder; None keeps this process's own.
        env: Variables set on top of this process's environment.
        cores: Cores the process and all its threads are pinned to; None leaves it to the
            system.
        log_path: File that gets a copy of all output; it is appended to.
        start_timeout_s: How long the game may take until it connects (used by the session).
        grace_s: How long a process may take to end politely before it is killed.
        num_last_lines: How many lines of output are kept for error reports.
    """

    command: tuple[str, ...]
    folder: Path | None = None
    env: Mapping[str, str] = field(default_factory=dict[str, str])
    cores: tuple[int, ...] | None = None
    log_path: Path | None = None
    start_timeout_s: float = 60.0
    grace_s: float = 2.0
    num_last_lines: int = 200


@dataclass(frozen=True, kw_only=True)
class GodotFlags:
    """Switches of a Godot game.

    Attributes:
        headless: Run without a window and without rendering.
        fixed_fps: Main-loop iterations per second of game time; this removes the cap on
            speed. None leaves the game at real time.
        user_args: Arguments for the game, such as ``--ludus-connect=…``.
        engine_args: Further arguments for the engine.
    """

    headless: bool = True
    fixed_fps: int | None = DEFAULT_FIXED_FPS
    user_args: tuple[str, ...] = ()
    engine_args: tuple[str, ...] = ()


def godot_command(
    engine: InstalledEngine, project: Path, scene: str | None, flags: GodotFlags
) -> tuple[str, ...]:
    """Build the command line that runs a scene of a project.

    Args:
        engine: The engine to run it with.
        project: Folder of ``project.godot``.
        scene: ``res://`` path, or None for the main scene.
        flags: Everything else.
    """
    program = str(engine.executable(headless=flags.headless))
    scene_args = () if scene is None else (scene,)
    arguments = (
        *_engine_flags(engine.kind, flags),
        "--path",
        str(project),
        *scene_args,
        *_user_args(flags),
    )
    return (
        _unseen(program, arguments)
        if flags.headless and engine.opens_window
        else (program, *arguments)
    )


def executable_command(program: Path, flags: GodotFlags) -> tuple[str, ...]:
    """Build the command line of an exported Godot game, or of one made with ``bevy_ludus``."""
    if is_bevy_game(program):
        is_real_time = flags.fixed_fps is None
        return bevy_command(
            program, flags.user_args, is_headless=flags.headless, is_real_time=is_real_time
        )
    kind = exported_with(program) or EngineKind.GODOT4
    arguments = (*_engine_flags(kind, flags), *_user_args(flags))
    if kind is EngineKind.GODOT3 and flags.headless:
        return _unseen(str(program), arguments)
    return (str(program), *arguments)


def _unseen(program: str, arguments: tuple[str, ...]) -> tuple[str, ...]:
    """Run a Godot 3 that opens a window so that nobody sees it, and let it draw nothing."""
    if sys.platform != "linux":  # there `_engine_flags` does it
        return (program, *arguments)
    command = (program, "--no-window", "--disable-render-loop", *arguments)
    # A game exported for servers needs no screen, and does not tell.
    return with_display(command) if has_screen() or find_xvfb() else command


def _engine_flags(kind: EngineKind, flags: GodotFlags) -> tuple[str, ...]:
    arguments: list[str] = []
    if kind is EngineKind.GODOT4:
        arguments += _godot4_display(flags)
    elif flags.headless and sys.platform in {"darwin", "win32"}:
        arguments += ["--no-window"]  # on Linux, Godot 3 has a build of its own for this
    if flags.fixed_fps is not None:
        arguments += ["--fixed-fps", str(flags.fixed_fps)]
    return (*arguments, *flags.engine_args)


def _godot4_display(flags: GodotFlags) -> list[str]:
    if flags.headless:
        return ["--headless"]
    # Faster than real time there is nothing to hear, and no screen to wait for.
    unpaced = ["--disable-vsync", "--audio-driver", "Dummy"] if flags.fixed_fps is not None else []
    return ["--rendering-driver", "opengl3", *unpaced]


def _user_args(flags: GodotFlags) -> tuple[str, ...]:
    return ("--", *flags.user_args) if flags.user_args else ()
