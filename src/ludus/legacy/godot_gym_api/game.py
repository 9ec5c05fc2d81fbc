"""One running game: start it or find it, ask it, end it."""

from __future__ import annotations

import time
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from ludus.errors import (
    ConfigError,
    EngineError,
    EngineStartError,
    EngineTimeout,
    ProtocolError,
    SequenceError,
)
from ludus.legacy.godot_gym_api.connection import Connection, connect
from ludus.legacy.godot_gym_api.ports import check_port_is_free, free_port
from ludus.legacy.launching import project_command, shell_command
from ludus.legacy.watching import GameWatch
from ludus.link import LinkClosed

__all__ = ["Game", "GameConfig"]

_PRINT_SETTLE_S = 0.2
_NUM_SHOWN = 60


@dataclass(frozen=True, kw_only=True)
class GameConfig:
    """How a game is started and talked with.

    Attributes:
        engine_address: Where the game listens. With port 0, a game that we start takes a free
            port; it must have our classes then.
        target: Project or scene to start. None, without ``command``, too: somebody else starts
            the game.
        command: What the shell runs to start the game; it gets further arguments at its end.
        frames_per_second: Frames in one second of game time, of a game that we start.
        is_windowed: Whether a game that we start draws.
        max_answer_bytes: Longest answer that the game may send.
        start_timeout_s: How long it may take until the game listens.
        step_timeout_s: How long an answer may take.
        log_path: File that gets a copy of what a game that we start prints.
        cores: Cores that a game which we start is pinned to; None: the system decides.
    """

    engine_address: tuple[str, int] = ("127.0.0.1", 9090)
    target: str | Path | None = None
    command: str | None = None
    frames_per_second: int = 60
    is_windowed: bool = False
    max_answer_bytes: int = 1 << 26
    start_timeout_s: float = 60.0
    step_timeout_s: float = 60.0
    log_path: str | Path | None = None
    cores: tuple[int, ...] | None = None


class Game:
    """A game that we are connected with.

    After an error the game is gone, if we started it, and the connection in any case; every later
    request raises ``SequenceError``.

    Raises:
        ConfigError: There are both target and command, or port 0 without either.
        TargetError: The target cannot be run.
        EngineStartError: The address is taken, or the game never listened there.
        EngineCrashed: The game ended before we were connected.
    """

    def __init__(self, config: GameConfig) -> None:
        _check(config)
        self._config = config
        self._connection: Connection | None = None
        self._watch = GameWatch()
        self._asked = (b"", 0.0)
        self.address = config.engine_address
        try:
            with ExitStack() as held:
                host, port = config.engine_address
                if port == 0:
                    self.address = (host, held.enter_context(free_port(host)))
                elif _is_ours(config):
                    check_port_is_free(self.address)
                if _is_ours(config):
                    self._watch = self._start()
                self._connection = self._connect()
        except BaseException:
            self.close()
            raise

    def send(self, request: bytes) -> None:
        """Send a request and return at once.

        Raises:
            SequenceError: The game is closed.
            EngineCrashed: It died, or hung up.
            EngineTimeout: It does not read.
            ProtocolError: It sent something that nobody had asked for.
        """
        connection = self._open_connection()
        try:
            if connection.has_unread():
                raise ProtocolError("the game sent an answer that nobody had asked for")
            self._asked = (request, time.monotonic())
            connection.send(request, self._config.step_timeout_s)
        except (LinkClosed, EngineTimeout) as error:
            raise self._failed(error) from error
        except BaseException:
            self.close()
            raise

    def receive(self) -> bytes:
        """Wait for the answer to :meth:`send`.

        Raises:
            SequenceError: The game is closed.
            EngineCrashed: It died, or hung up.
            EngineTimeout: It did not answer.
            ProtocolError: Its answer is too long.
            GameError: A script of it failed.
        """
        connection = self._open_connection()
        _, began = self._asked
        deadline = began + self._config.step_timeout_s
        try:
            return connection.receive(deadline, lambda: self._watch.check_new_errors(began))
        except (LinkClosed, EngineTimeout) as error:
            raise self._failed(error) from error
        except BaseException:
            # Whoever is interrupted between request and answer cannot go on, either.
            self.close()
            raise

    def note_errors(self) -> None:
        """Take the script errors so far for known; new ones explain a missing answer."""
        self._watch.note_errors()

    def close(self) -> None:
        """End the conversation, and the game if we started it; may be called twice."""
        if self._connection is not None:
            self._connection.close()
            self._connection = None
        self._watch.close()

    def _open_connection(self) -> Connection:
        if self._connection is None:
            raise SequenceError(
                "the game is closed, or an error ended it", hint="make the environment anew"
            )
        return self._connection

    def _failed(self, error: LinkClosed | EngineTimeout) -> EngineError:
        """End a game that went or is silent; return what says what became of it."""
        try:
            if isinstance(error, LinkClosed):
                # A game that lives has printed why it sent us away.
                time.sleep(_PRINT_SETTLE_S)
                return self._watch.explain(str(error))
            request, timeout_s = self._asked[0], self._config.step_timeout_s
            silent = EngineTimeout(
                f"the game did not answer {_shown(request)} within {timeout_s:g} s",
                hint="a game serves one client at a time, and answers when its step has ended; "
                "if a step really takes longer, raise step_timeout_s",
            )
            return self._watch.explain_silence(silent)
        finally:
            self.close()

    def _start(self) -> GameWatch:
        config = self._config
        # Only a game with our classes knows this argument.
        arguments = (f"--ludus-port={self.address[1]}",)
        fps, drawing = config.frames_per_second, config.is_windowed
        if config.target is not None:
            command = project_command(config.target, arguments, fps, is_windowed=drawing)
        else:
            command = shell_command(config.command or "", arguments, fps, is_windowed=drawing)
        log_path = None if config.log_path is None else Path(config.log_path)
        return GameWatch.start(command, log_path, config.cores)

    def _connect(self) -> Connection:
        config = self._config
        try:
            return connect(
                self.address,
                config.start_timeout_s,
                config.max_answer_bytes,
                self._watch.check_alive,
            )
        except EngineTimeout as error:
            raise EngineStartError(
                f"{error.message}{self._watch.report()}",
                hint="the scene needs an RLEnvironment that calls communication.start_server with "
                "this port; if loading takes longer, raise start_timeout_s",
            ) from error


def _check(config: GameConfig) -> None:
    if config.target is not None and config.command is not None:
        raise ConfigError(
            "both target and command are given", hint="one of them says how the game starts"
        )
    if config.engine_address[1] == 0 and not _is_ours(config):
        raise ConfigError(
            "engine_address has port 0, which only a game that we start can take",
            hint="give target or command, or the port at which the game listens",
        )


def _is_ours(config: GameConfig) -> bool:
    return config.target is not None or config.command is not None


def _shown(request: bytes) -> str:
    text = request[:_NUM_SHOWN].decode(errors="replace")
    return text if len(request) <= _NUM_SHOWN else f"{text}…"
