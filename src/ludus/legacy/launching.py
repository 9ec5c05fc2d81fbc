"""The process of a legacy game: started if that is asked for, watched, and ended with this one."""

from __future__ import annotations

import os
import shlex
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path

from ludus.engine import (
    EngineProcess,
    GodotFlags,
    LaunchConfig,
    ensure_imported,
    executable_command,
    godot_command,
    with_display,
)
from ludus.engine.process_group import CMD
from ludus.errors import GameError, TargetError
from ludus.session.supervision import Supervision
from ludus.target import Executable, Scene, parse_target

__all__ = ["GameLaunch", "GameWatch"]

# The game becomes the leader of its process group; the loop beside it ends the group. Its output
# goes nowhere, or the game's would seem to go on when the game has ended.
_DIE_WITH_PARENT = (
    '(while kill -0 "$0" 2>/dev/null; do sleep 1; done; kill -TERM -$$) '
    '</dev/null >/dev/null 2>&1 & exec "$@"'
)
_SCRIPT_ERROR_S = 1.0
_IS_POSIX = os.name == "posix"


@dataclass(frozen=True, kw_only=True)
class GameLaunch:
    """How a game is started; without ``target`` and ``command`` somebody else does that.

    Attributes:
        target: Project or scene to start.
        command: What the shell runs to start the game; it gets further arguments at its end.
        frames_per_second: Frames in one second of game time, of a game that we start.
        is_windowed: Whether a game that we start draws.
        log_path: File that gets a copy of what a game that we start prints.
        cores: Cores that a game which we start is pinned to; None: the system decides.
        engine_args: Further arguments for the engine of a ``target``.
        has_engine_arguments: Whether the game looks for its arguments among those of the engine,
            before a ``--``.
    """

    target: str | Path | None = None
    command: str | None = None
    frames_per_second: int = 60
    is_windowed: bool = False
    log_path: str | Path | None = None
    cores: tuple[int, ...] | None = None
    engine_args: tuple[str, ...] = ()
    has_engine_arguments: bool = False

    @property
    def is_ours(self) -> bool:
        """Whether we start the game."""
        return self.target is not None or self.command is not None

    def start(self, arguments: tuple[str, ...]) -> GameWatch:
        """Start the game, if it is ours; it ends with its watch, or with this process.

        Args:
            arguments: What the game itself is told, behind what the engine is told.

        Raises:
            TargetError: The target cannot be run.
            EngineNotFound: There is no engine to run it with.
            EngineStartError: It cannot be started.
        """
        if not self.is_ours:
            return GameWatch(None)
        log_path = None if self.log_path is None else Path(self.log_path)
        command = self.command_line(arguments)
        config = LaunchConfig(command=command, log_path=log_path, cores=self.cores)
        return GameWatch(EngineProcess.start(config))

    def command_line(self, arguments: tuple[str, ...]) -> tuple[str, ...]:
        """Return the command that :meth:`start` runs; errors as there."""
        if self.target is None:
            return _end_with_us(self._shell_command(arguments))
        of_engine = arguments if self.has_engine_arguments else ()
        flags = GodotFlags(
            headless=not self.is_windowed,
            fixed_fps=self.frames_per_second,
            user_args=() if self.has_engine_arguments else arguments,
            engine_args=(*self._drawing, *self.engine_args, *of_engine),
        )
        command = self._engine_command(flags)
        return _end_with_us(with_display(command) if self.is_windowed else command)

    def _engine_command(self, flags: GodotFlags) -> tuple[str, ...]:
        assert self.target is not None
        game = parse_target(self.target)
        if isinstance(game, Executable):
            return executable_command(game.path, flags)
        if not isinstance(game, Scene):
            raise TargetError(
                f"{self.target} is neither a Godot project, nor a scene, nor an exported game",
                hint="name the folder of a project, a .tscn or a program; start anything else "
                "with a shell command",
            )
        engine = game.find_engine()
        ensure_imported(engine, game.project)
        return godot_command(engine, game.project.root, game.path, flags)

    def _shell_command(self, arguments: tuple[str, ...]) -> tuple[str, ...]:
        added = ("--fixed-fps", str(self.frames_per_second), *self._drawing, *arguments)
        if not _IS_POSIX:
            return (*CMD, f"{self.command} {subprocess.list2cmdline(added)}")
        return ("/bin/sh", "-c", f"{self.command} {shlex.join(added)}")

    @property
    def _drawing(self) -> tuple[str, ...]:
        return () if self.is_windowed else ("--disable-render-loop",)


class GameWatch(Supervision):
    """Watches the process of a game whose wire has no word for a mistake.

    Args:
        process: The game; None if somebody else started it.
    """

    def __init__(self, process: EngineProcess | None) -> None:
        super().__init__(process)
        self._known_errors: set[str] = set()

    def note_errors(self) -> None:
        """Take the script errors so far for known; new ones explain a missing answer."""
        if self._process is not None:
            self._known_errors = set(self._process.script_errors)

    def check_new_errors(self, began: float) -> None:
        """Raise early if a script has failed since :meth:`note_errors`: no answer will come.

        Args:
            began: When waiting for the answer began, on the clock of ``time.monotonic``, seconds;
                nothing is looked at in the first second.

        Raises:
            GameError: A script has failed; the text holds what the engine printed.
        """
        if self._process is None or time.monotonic() - began < _SCRIPT_ERROR_S:
            return
        if set(self._process.script_errors) - self._known_errors:
            raise GameError(
                f"a script of the game failed:{self.script_errors()}",
                hint="the script and its line follow `at:`",
            )

    def report(self) -> str:
        """Return what became of the game, to add to a message; nothing if it is not ours."""
        return "" if self._process is None else f": {self._process.describe_death()}"

    def wait(self, timeout_s: float) -> None:
        """Wait for the end of the game, if it is ours."""
        if self._process is not None:
            self._process.wait(timeout_s)


def _end_with_us(command: tuple[str, ...]) -> tuple[str, ...]:
    """Let a game that does not know us end when this process is gone, however that came.

    Games of legacy bridges wait for the next client for ever.
    """
    if not _IS_POSIX:
        return command
    return ("/bin/sh", "-c", _DIE_WITH_PARENT, str(os.getpid()), *command)
