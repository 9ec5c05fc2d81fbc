"""How a game is started: its command line, its environment and its limits."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from ludus.engine.exported import exported_with, is_bevy_game
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
        grace_s: How long the process may take to end by itself before it is killed.
        num_last_lines: How many lines of output are kept for error reports.
    """

    command: tuple[str, ...]
    folder: Path | None = None
    env: Mapping[str, str] = field(default_factory=dict[str, str])
    cores: tuple[int, ...] | None = None
    log_path: Path | None = None
    grace_s: float = 2.0
    num_last_lines: int = 200


@dataclass(frozen=True, kw_only=True)
class GodotFlags:
    """Switches of a Godot game.

    Attributes:
        headless: Run without a window and without rendering.
        fixed_fps: Main-loop iterations per second of game time; this removes the cap on
            speed. None runs the game in real time.
        user_args: Arguments for the add-on, such as ``--ludus-connect=…``.
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
    arguments = (*_engine_args(engine.kind, flags), "--path", str(project), *scene_args)
    if flags.headless and engine.opens_window:
        return _hidden_command(program, (*arguments, *_user_args(flags)))
    return (program, *arguments, *_user_args(flags))


def executable_command(program: Path, flags: GodotFlags) -> tuple[str, ...]:
    """Build the command line of an exported Godot game, or of one made with ``bevy_ludus``."""
    if is_bevy_game(program):  # it knows none of Godot's switches
        headless = ("--ludus-headless",) if flags.headless else ()
        real_time = ("--ludus-real-time",) if flags.fixed_fps is None else ()
        return (str(program), *flags.user_args, *headless, *real_time)
    kind = exported_with(program) or EngineKind.GODOT4
    arguments = (*_engine_args(kind, flags), *_user_args(flags))
    if kind is EngineKind.GODOT3 and flags.headless:
        return _hidden_command(str(program), arguments)
    return (str(program), *arguments)


def _hidden_command(program: str, arguments: tuple[str, ...]) -> tuple[str, ...]:
    """Hide the window of a Godot 3 that always opens one, and let it draw nothing."""
    if sys.platform != "linux":  # `_engine_args` hides it there
        return (program, *arguments)
    command = (program, "--no-window", "--disable-render-loop", *arguments)
    # A game exported for servers needs no screen, and cannot be told apart from others.
    return with_display(command) if has_screen() or find_xvfb() else command


def _engine_args(kind: EngineKind, flags: GodotFlags) -> tuple[str, ...]:
    arguments: list[str] = []
    if kind is EngineKind.GODOT3:
        if flags.headless and sys.platform in {"darwin", "win32"}:
            arguments += ["--no-window"]  # on Linux, Godot 3 has a separate build for this
    elif flags.headless:
        arguments += ["--headless"]
    else:
        arguments += ["--rendering-driver", "opengl3"]
        if flags.fixed_fps is not None:
            # A game that is not in real time needs no sound, and must not wait for the screen.
            arguments += ["--disable-vsync", "--audio-driver", "Dummy"]
    if flags.fixed_fps is not None:
        arguments += ["--fixed-fps", str(flags.fixed_fps)]
    return (*arguments, *flags.engine_args)


def _user_args(flags: GodotFlags) -> tuple[str, ...]:
    return ("--", *flags.user_args) if flags.user_args else ()
