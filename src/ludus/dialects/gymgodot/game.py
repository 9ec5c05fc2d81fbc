"""One running GymGodot game: start it, ask it, end it."""

from __future__ import annotations

import os
import shlex
import subprocess
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from ludus.dialects.gymgodot.door import Door
from ludus.dialects.gymgodot.messages import (
    CLOSE_REQUEST,
    RENDER_REQUEST,
    RESET_REQUEST,
    StepAnswer,
    read_render,
    read_reset,
    read_step,
    step_request,
)
from ludus.dialects.gymgodot.web_socket import WebSocket
from ludus.engine import EngineProcess, LaunchConfig
from ludus.errors import (
    EngineCrashed,
    EngineStartError,
    EngineTimeout,
    GameError,
    ProtocolError,
    SequenceError,
)
from ludus.link import LinkClosed
from ludus.session.supervision import Supervision

__all__ = ["Game", "GameConfig"]

_Answer = TypeVar("_Answer")
_QUIT_S = 3.0
_SCRIPT_ERROR_S = 1.0
_NO_SCREEN = "Display is not available"
_RENDERER_HINT = (
    "saving frames takes a renderer: run godot3, not godot3-server, on a desktop or in "
    "`xvfb-run -a -s '-screen 0 1280x1024x24' godot3 …`"
)


@dataclass(frozen=True, kw_only=True)
class GameConfig:
    """How a game is started and talked with.

    Attributes:
        host: Address at which we wait for the game.
        port: Port there; 0 takes a free one.
        command: What the shell runs; it gets further arguments at its end. None: somebody else
            starts the game.
        is_windowed: Whether the game draws while it steps.
        frames_per_second: Frames in one second of game time.
        render_path: What the game puts before the number of a saved frame.
        max_message_bytes: Longest message that the game may send.
        start_timeout_s: How long it may take until the game has connected.
        step_timeout_s: How long an answer may take.
        log_path: File that gets a copy of what the game prints.
    """

    host: str
    port: int
    command: str | None
    is_windowed: bool
    frames_per_second: int
    render_path: str
    max_message_bytes: int
    start_timeout_s: float
    step_timeout_s: float
    log_path: Path | None


class Game:
    """A game that has connected.

    After an error the game is gone; every later request raises ``SequenceError``.

    Raises:
        EngineStartError: The port is taken, or the game never connected.
        EngineCrashed: The command ended before the game connected.
    """

    def __init__(self, config: GameConfig) -> None:
        self._config = config
        self._link: WebSocket | None = None
        self._process: EngineProcess | None = None
        self._known_errors: set[str] = set()
        door = Door(config.host, config.port)
        self.port = door.port
        try:
            self._process = _start(config, door.port)
            self._link = self._await_game(door)
        except BaseException:
            self._end()
            raise
        finally:
            door.close()

    @property
    def frames_per_second(self) -> int:
        """Frames in one second of game time."""
        return self._config.frames_per_second

    def reset(self) -> Any:
        """Begin an episode; return the first observation as lists. Errors as :meth:`step`."""
        if self._process is not None:
            self._known_errors = set(self._process.script_errors)
        return self._ask(RESET_REQUEST, read_reset)

    def step(self, action: Any) -> StepAnswer:
        """Act.

        Args:
            action: List of numbers.

        Raises:
            SequenceError: The game is closed.
            EngineCrashed: It died.
            EngineTimeout: It did not answer.
            ProtocolError: It sent something else than an answer.
            GameError: A script of it failed, or the reward is not finite.
        """
        return self._ask(step_request(action), read_step)

    def render(self) -> int:
        """Have the current frame saved; return Godot's error code. Errors as :meth:`step`."""
        try:
            return self._ask(RENDER_REQUEST, read_render)
        except GameError as error:
            raise GameError(error.message, _RENDERER_HINT) from error

    def close(self) -> None:
        """Ask the game to quit, and end what is still there; may be called twice."""
        if self._link is not None:
            try:
                self._link.send(CLOSE_REQUEST, _QUIT_S)
            except (LinkClosed, EngineTimeout):
                pass
            else:
                self._link.drain(_QUIT_S)
                self._link.close()
                if self._process is not None:
                    self._process.wait(_QUIT_S)
        self._end()

    def _ask(self, request: str, read: Callable[[bytes], _Answer]) -> _Answer:
        link = self._link
        if link is None:
            raise SequenceError(
                "the game is closed, or an error ended it", hint="make the environment anew"
            )
        try:
            return read(self._exchange(link, request))
        except BaseException:
            # Whoever is interrupted between request and answer cannot go on, either.
            self._end()
            raise

    def _exchange(self, link: WebSocket, request: str) -> bytes:
        if link.has_message:
            raise ProtocolError("the game sent a message that nobody had asked for")
        began = time.monotonic()
        try:
            link.send(request, self._config.step_timeout_s)
            return link.receive(
                began + self._config.step_timeout_s, lambda: self._check_scripts(began)
            )
        except LinkClosed as error:
            raise self._supervision().explain(str(error)) from error
        except EngineTimeout as error:
            silent = EngineTimeout(
                f"the game did not answer {request[:40]} within {self._config.step_timeout_s:g} s",
                hint="a game that is paused or hangs never answers; if a step really takes "
                "longer, raise step_timeout_s",
            )
            raise self._supervision().explain_silence(silent) from error

    def _check_scripts(self, began: float) -> None:
        """Raise early if a script failed since the last reset: the answer will never come."""
        if self._process is None or time.monotonic() - began < _SCRIPT_ERROR_S:
            return
        if set(self._process.script_errors) - self._known_errors:
            raise GameError(
                f"a script of the game failed:{self._supervision().script_errors()}",
                hint="the script and its line stand behind `at:`",
            )

    def _await_game(self, door: Door) -> WebSocket:
        config = self._config
        try:
            return door.accept(
                config.start_timeout_s, config.max_message_bytes, self._supervision().check_alive
            )
        except EngineCrashed as error:
            if _NO_SCREEN in error.message:
                raise EngineCrashed(error.message, _RENDERER_HINT) from error
            raise
        except EngineTimeout as error:
            report = "" if self._process is None else f": {self._process.describe_death()}"
            raise EngineStartError(
                f"{error.message} at {config.host}:{door.port}{report}",
                hint="the scene needs an enabled GymGodot node, and exeCmd must pass on the "
                "arguments put at its end; if loading takes longer, raise start_timeout_s",
            ) from error

    def _supervision(self) -> Supervision:
        return Supervision(self._process)

    def _end(self) -> None:
        if self._link is not None:
            self._link.close()
            self._link = None
        if self._process is not None:
            self._process.terminate()
            self._process = None


def _start(config: GameConfig, port: int) -> EngineProcess | None:
    if config.command is None:
        return None
    line = f"{config.command} {_join(_arguments(config, port))}"
    shell = ("/bin/sh", "-c", line) if os.name == "posix" else ("cmd", "/s", "/c", line)
    return EngineProcess.start(LaunchConfig(command=shell, log_path=config.log_path))


def _arguments(config: GameConfig, port: int) -> tuple[str, ...]:
    return (
        *("--fixed-fps", str(config.frames_per_second)),
        *(() if config.is_windowed else ("--disable-render-loop",)),
        f"--serverIP={config.host}",
        f"--serverPort={port}",
        f"--renderPath={config.render_path}",
    )


def _join(arguments: tuple[str, ...]) -> str:
    return shlex.join(arguments) if os.name == "posix" else subprocess.list2cmdline(arguments)
