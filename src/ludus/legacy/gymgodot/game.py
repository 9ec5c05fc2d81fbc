"""One running GymGodot game: start it, ask it, end it."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from ludus.errors import (
    EngineCrashed,
    EngineError,
    EngineStartError,
    EngineTimeout,
    GameError,
    ProtocolError,
    SequenceError,
)
from ludus.legacy.gymgodot.door import Door
from ludus.legacy.gymgodot.frames import DEFAULT_RENDER_PATH
from ludus.legacy.gymgodot.messages import (
    CLOSE_REQUEST,
    RENDER_REQUEST,
    RESET_REQUEST,
    StepAnswer,
    read_render,
    read_reset,
    read_step,
    step_request,
)
from ludus.legacy.gymgodot.web_socket import WebSocket
from ludus.legacy.launching import project_command, shell_command
from ludus.legacy.watching import GameWatch
from ludus.link import LinkClosed

__all__ = ["Game", "GameConfig"]

_Answer = TypeVar("_Answer")
_QUIT_S = 3.0
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
        target: Project or scene to start.
        command: What the shell runs; it gets further arguments at its end. None, without
            ``target``, too: somebody else starts the game.
        is_windowed: Whether the game draws while it steps.
        frames_per_second: Frames in one second of game time.
        render_path: What the game puts before the number of a saved frame.
        max_message_bytes: Longest message that the game may send.
        start_timeout_s: How long it may take until the game has connected.
        step_timeout_s: How long an answer may take.
        log_path: File that gets a copy of what the game prints.
        cores: Cores that a game which we start is pinned to; None: the system decides.
    """

    host: str = "127.0.0.1"
    port: int = 0
    target: Path | None = None
    command: str | None = None
    is_windowed: bool = False
    frames_per_second: int = 60
    render_path: str = DEFAULT_RENDER_PATH
    max_message_bytes: int
    start_timeout_s: float = 60.0
    step_timeout_s: float = 60.0
    log_path: Path | None = None
    cores: tuple[int, ...] | None = None


class Game:
    """A game that has connected.

    After an error the game is gone; every later request raises ``SequenceError``.

    Raises:
        TargetError: The target cannot be run.
        EngineStartError: The port is taken, or the game never connected.
        EngineCrashed: The command ended before the game connected.
    """

    def __init__(self, config: GameConfig) -> None:
        self._config = config
        self._link: WebSocket | None = None
        self._watch = GameWatch()
        self._asked = ("", 0.0)
        door = Door(config.host, config.port)
        self.port = door.port
        try:
            self._watch = _start(config, door.port)
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
        """Begin an episode; return the first observation as lists. Errors as :meth:`end_step`."""
        self._watch.note_errors()
        return self._ask(RESET_REQUEST, read_reset)

    def begin_step(self, action: Any) -> None:
        """Act, and return at once.

        Args:
            action: List of numbers.

        Raises:
            SequenceError: The game is closed.
            EngineCrashed: It died.
            EngineTimeout: It does not read.
            ProtocolError: It sent something that nobody had asked for.
        """
        self._send(step_request(action))

    def end_step(self) -> StepAnswer:
        """Wait for what :meth:`begin_step` led to.

        Raises:
            SequenceError: The game is closed.
            EngineCrashed: It died.
            EngineTimeout: It did not answer.
            ProtocolError: It sent something else than an answer.
            GameError: A script of it failed, or the reward is not finite.
        """
        return self._receive(read_step)

    def render(self) -> int:
        """Have the current frame saved; return Godot's error code. Errors as :meth:`end_step`."""
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
                self._watch.wait(_QUIT_S)
        self._end()

    def _ask(self, request: str, read: Callable[[bytes], _Answer]) -> _Answer:
        self._send(request)
        return self._receive(read)

    def _send(self, request: str) -> None:
        link = self._open_link()
        try:
            if link.has_message:
                raise ProtocolError("the game sent a message that nobody had asked for")
            self._asked = (request, time.monotonic())
            link.send(request, self._config.step_timeout_s)
        except (LinkClosed, EngineTimeout) as error:
            raise self._failed(error) from error
        except BaseException:
            self._end()
            raise

    def _receive(self, read: Callable[[bytes], _Answer]) -> _Answer:
        link = self._open_link()
        _, began = self._asked
        deadline = began + self._config.step_timeout_s
        try:
            return read(link.receive(deadline, lambda: self._watch.check_new_errors(began)))
        except (LinkClosed, EngineTimeout) as error:
            raise self._failed(error) from error
        except BaseException:
            # Whoever is interrupted between request and answer cannot go on, either.
            self._end()
            raise

    def _open_link(self) -> WebSocket:
        if self._link is None:
            raise SequenceError(
                "the game is closed, or an error ended it", hint="make the environment anew"
            )
        return self._link

    def _failed(self, error: LinkClosed | EngineTimeout) -> EngineError:
        """End a game that went or is silent; return what says what became of it."""
        try:
            if isinstance(error, LinkClosed):
                return self._watch.explain(str(error))
            request, timeout_s = self._asked[0], self._config.step_timeout_s
            silent = EngineTimeout(
                f"the game did not answer {request[:40]} within {timeout_s:g} s",
                hint="a game that is paused or hangs never answers; if a step really takes "
                "longer, raise step_timeout_s",
            )
            return self._watch.explain_silence(silent)
        finally:
            self._end()

    def _await_game(self, door: Door) -> WebSocket:
        config = self._config
        try:
            return door.accept(
                config.start_timeout_s, config.max_message_bytes, self._watch.check_alive
            )
        except EngineCrashed as error:
            if _NO_SCREEN in error.message:
                raise EngineCrashed(error.message, _RENDERER_HINT) from error
            raise
        except EngineTimeout as error:
            raise EngineStartError(
                f"{error.message} at {config.host}:{door.port}{self._watch.report()}",
                hint="the scene needs an enabled GymGodot node, and exeCmd must pass on the "
                "arguments put at its end; if loading takes longer, raise start_timeout_s",
            ) from error

    def _end(self) -> None:
        if self._link is not None:
            self._link.close()
            self._link = None
        self._watch.close()


def _start(config: GameConfig, port: int) -> GameWatch:
    arguments = (
        f"--serverIP={config.host}",
        f"--serverPort={port}",
        f"--renderPath={config.render_path}",
    )
    drawing, fps = config.is_windowed, config.frames_per_second
    if config.target is not None:
        command = project_command(config.target, arguments, fps, is_windowed=drawing)
    elif config.command is not None:
        command = shell_command(config.command, arguments, fps, is_windowed=drawing)
    else:
        return GameWatch()
    return GameWatch.start(command, config.log_path, config.cores)
