"""One running game: start it or find it, ask it, end it."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

from ludus.dialects.godot_gym_api.connection import Connection, connect
from ludus.dialects.godot_gym_api.launching import (
    check_port_is_free,
    free_port,
    shell_command,
    target_command,
)
from ludus.engine import EngineProcess, LaunchConfig
from ludus.errors import (
    ConfigError,
    EngineError,
    EngineStartError,
    EngineTimeout,
    GameError,
    ProtocolError,
    SequenceError,
)
from ludus.link import LinkClosed
from ludus.session.supervision import Supervision

__all__ = ["Game", "GameConfig"]

_SCRIPT_ERROR_S = 1.0
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
        self._process: EngineProcess | None = None
        self._known_errors: set[str] = set()
        host, port = config.engine_address
        is_ours = config.target is not None or config.command is not None
        self.address = (host, port or free_port(host)) if is_ours else (host, port)
        try:
            if is_ours:
                self._process = self._start()
            self._connection = self._connect()
        except BaseException:
            self.close()
            raise

    def exchange(self, request: bytes) -> bytes:
        """Send a request and return its answer.

        Raises:
            SequenceError: The game is closed.
            EngineCrashed: It died, or hung up.
            EngineTimeout: It did not answer.
            ProtocolError: It sent something else than one answer.
            GameError: A script of it failed.
        """
        connection = self._connection
        if connection is None:
            raise SequenceError(
                "the game is closed, or an error ended it", hint="make the environment anew"
            )
        try:
            return self._exchange(connection, request)
        except BaseException:
            # Whoever is interrupted between request and answer cannot go on, either.
            self.close()
            raise

    def note_errors(self) -> None:
        """Take the script errors so far for known; new ones explain a missing answer."""
        if self._process is not None:
            self._known_errors = set(self._process.script_errors)

    def close(self) -> None:
        """End the conversation, and the game if we started it; may be called twice."""
        if self._connection is not None:
            self._connection.close()
            self._connection = None
        if self._process is not None:
            self._process.terminate()
            self._process = None

    def _exchange(self, connection: Connection, request: bytes) -> bytes:
        if connection.has_unread():
            raise ProtocolError("the game sent an answer that nobody had asked for")
        began, timeout_s = time.monotonic(), self._config.step_timeout_s
        try:
            connection.send(request, timeout_s)
            return connection.receive(began + timeout_s, lambda: self._check_scripts(began))
        except LinkClosed as error:
            raise self._explain_end(error) from error
        except EngineTimeout as error:
            silent = EngineTimeout(
                f"the game did not answer {_shown(request)} within {timeout_s:g} s",
                hint="a game serves one client at a time, and answers when its step has ended; "
                "if a step really takes longer, raise step_timeout_s",
            )
            raise self._supervision().explain_silence(silent) from error

    def _explain_end(self, error: LinkClosed) -> EngineError:
        # A game that lives has printed why it sent us away.
        time.sleep(_PRINT_SETTLE_S)
        return self._supervision().explain(str(error))

    def _check_scripts(self, began: float) -> None:
        """Raise early if a script failed since the last reset: the answer will never come."""
        if self._process is None or time.monotonic() - began < _SCRIPT_ERROR_S:
            return
        if set(self._process.script_errors) - self._known_errors:
            raise GameError(
                f"a script of the game failed:{self._supervision().script_errors()}",
                hint="the script and its line stand behind `at:`",
            )

    def _start(self) -> EngineProcess:
        check_port_is_free(self.address)
        config, port = self._config, self.address[1]
        if config.target is not None:
            command = target_command(
                config.target, port, config.frames_per_second, is_windowed=config.is_windowed
            )
        else:
            command = shell_command(
                config.command or "", port, config.frames_per_second, is_windowed=config.is_windowed
            )
        log_path = None if config.log_path is None else Path(config.log_path)
        return EngineProcess.start(LaunchConfig(command=command, log_path=log_path))

    def _connect(self) -> Connection:
        config = self._config
        try:
            return connect(
                self.address,
                config.start_timeout_s,
                config.max_answer_bytes,
                self._supervision().check_alive,
            )
        except EngineTimeout as error:
            report = "" if self._process is None else f": {self._process.describe_death()}"
            raise EngineStartError(
                f"{error.message}{report}",
                hint="the scene needs an RLEnvironment that calls communication.start_server with "
                "this port; if loading takes longer, raise start_timeout_s",
            ) from error

    def _supervision(self) -> Supervision:
        return Supervision(self._process)


def _check(config: GameConfig) -> None:
    if config.target is not None and config.command is not None:
        raise ConfigError(
            "both target and command are given", hint="one of them says how the game starts"
        )
    is_ours = config.target is not None or config.command is not None
    if config.engine_address[1] == 0 and not is_ours:
        raise ConfigError(
            "engine_address has port 0, which only a game that we start can take",
            hint="give target or command, or the port at which the game listens",
        )


def _shown(request: bytes) -> str:
    text = request[:_NUM_SHOWN].decode(errors="replace")
    return text if len(request) <= _NUM_SHOWN else f"{text}…"
