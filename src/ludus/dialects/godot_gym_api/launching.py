"""The command that starts a game, and that ends the game when this process is gone."""

from __future__ import annotations

import os
import shlex
import socket
import subprocess
from pathlib import Path

from ludus.engine import (
    GodotFlags,
    Project,
    ensure_imported,
    godot_command,
    resolve_target,
    with_display,
)
from ludus.errors import ConfigError, EngineStartError, TargetError

__all__ = ["check_port_is_free", "free_port", "shell_command", "target_command"]

_MAX_PORT = 65535
# The game becomes the leader of its process group; the loop beside it ends the group. Its output
# goes nowhere, or the game's would seem to go on when the game has ended.
_LEASH = (
    '(while kill -0 "$0" 2>/dev/null; do sleep 1; done; kill -TERM -$$) '
    '</dev/null >/dev/null 2>&1 & exec "$@"'
)


def target_command(
    target: str | Path, port: int, frames_per_second: int, *, is_windowed: bool
) -> tuple[str, ...]:
    """Return the command that runs a project or a scene.

    Args:
        target: Folder of a Godot project, or a scene of one.
        port: Where the game shall listen, if it has our classes; others do not know the argument.
        frames_per_second: Frames in one second of game time.
        is_windowed: Whether the game draws.

    Raises:
        TargetError: It is something else, or does not exist.
        EngineNotFound: There is no engine to run it with.
    """
    found = resolve_target(target)
    project = _project_of(found.project, target)
    engine = found.find_engine()
    assert engine is not None
    ensure_imported(engine, project)
    flags = GodotFlags(
        headless=not is_windowed,
        fixed_fps=frames_per_second,
        user_args=(_port_argument(port),),
        engine_args=_drawing(is_windowed=is_windowed),
    )
    command = godot_command(engine, project.root, found.scene, flags)
    return _leashed(with_display(command) if is_windowed else command)


def shell_command(
    line: str, port: int, frames_per_second: int, *, is_windowed: bool
) -> tuple[str, ...]:
    """Return the command that has the shell run a line, with our arguments at its end."""
    arguments = (
        *("--fixed-fps", str(frames_per_second)),
        *_drawing(is_windowed=is_windowed),
        _port_argument(port),
    )
    if os.name != "posix":
        return ("cmd", "/s", "/c", f"{line} {subprocess.list2cmdline(arguments)}")
    return _leashed(("/bin/sh", "-c", f"{line} {shlex.join(arguments)}"))


def free_port(host: str) -> int:
    """Return a port that nobody uses at the moment."""
    with socket.create_server((host, 0)) as taken:
        return taken.getsockname()[1]


def check_port_is_free(address: tuple[str, int]) -> None:
    """Refuse to start a game where another one listens: we would talk with that.

    Raises:
        EngineStartError: Somebody listens there.
        ConfigError: That is no port.
    """
    host, port = address
    if not 1 <= port <= _MAX_PORT:
        raise ConfigError(f"engine_address has the port {port}, expected 0 to {_MAX_PORT}")
    try:
        socket.create_connection(address, 1.0).close()
    except OSError:
        return
    raise EngineStartError(
        f"something listens at {host}:{port} already",
        hint="end the game that runs there; a game with Ludus's classes takes any free port if "
        "engine_address has port 0",
    )


def _project_of(project: Project | None, target: str | Path) -> Project:
    if project is None:
        raise TargetError(
            f"{target} is no Godot project and no scene",
            hint="start an exported game with command=…, or attach to a running one with "
            "engine_address=(host, port)",
        )
    return project


def _drawing(*, is_windowed: bool) -> tuple[str, ...]:
    return () if is_windowed else ("--disable-render-loop",)


def _port_argument(port: int) -> str:
    return f"--ludus-port={port}"


def _leashed(command: tuple[str, ...]) -> tuple[str, ...]:
    """Let a game that does not know us end when this process is gone, however that came.

    godot_gym_api's games wait for the next client for ever.
    """
    if os.name != "posix":
        return command
    return ("/bin/sh", "-c", _LEASH, str(os.getpid()), *command)
