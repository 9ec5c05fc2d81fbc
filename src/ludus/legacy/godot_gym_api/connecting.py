"""Start a game for godot_gym_api or find one that runs, and connect; the game is the server."""

from __future__ import annotations

import socket
import sys
from collections.abc import Generator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

from ludus.errors import ConfigError, EngineStartError, EngineTimeout
from ludus.legacy.conversation import Conversation, Patience
from ludus.legacy.launching import GameLaunch
from ludus.legacy.length_framing import LengthFraming
from ludus.link import ByteStream, connect_until, refuse_stranger

__all__ = [
    "ConnectionSettings",
    "check_port_is_free",
    "free_port",
    "open_conversation",
]

_MAX_PORT = 65535
_SILENCE_HINT = (
    "a game serves one client at a time, and answers when its step has ended; if a step really "
    "takes longer, raise step_timeout_s"
)
_TOO_LONG_HINT = (
    "is what answers there a game for godot_gym_api? If answers really are as long, raise "
    "max_answer_bytes"
)


@dataclass(frozen=True, kw_only=True)
class ConnectionSettings(GameLaunch):
    """How a game is started and reached.

    Attributes:
        engine_address: Where the game listens. With port 0, a game that we start takes a free
            port; it must have our classes then.
        max_answer_bytes: Longest answer that the game may send.
        start_timeout_s: How long it may take until the game listens, seconds.
        step_timeout_s: How long an answer may take, seconds.
    """

    engine_address: tuple[str, int] = ("127.0.0.1", 9090)
    max_answer_bytes: int = 1 << 26
    start_timeout_s: float = 60.0
    step_timeout_s: float = 60.0


def open_conversation(settings: ConnectionSettings) -> tuple[Conversation[bytes], tuple[str, int]]:
    """Start a game if it is ours, and connect; return the conversation and the game's address.

    Raises:
        ConfigError: There are both target and command, or port 0 without either.
        TargetError: The target cannot be run.
        EngineStartError: The address is taken, or the game never listened there.
        EngineCrashed: The game ended before we were connected.
    """
    _check(settings)
    with ExitStack() as held:
        host, port = settings.engine_address
        if port == 0:
            port = held.enter_context(free_port(host))
        elif settings.is_ours:
            check_port_is_free((host, port))
        # Only a game with our classes knows this argument.
        watch = settings.start((f"--ludus-port={port}",))
        try:
            connection = connect_until((host, port), settings.start_timeout_s, watch.check_alive)
            refuse_stranger((host, port))
        except EngineTimeout as error:
            report = watch.report()
            watch.close()
            raise EngineStartError(
                f"{error.message}{report}",
                hint="the scene needs an RLEnvironment that calls communication.start_server with "
                "this port; if loading takes longer, raise start_timeout_s",
            ) from error
        except BaseException:
            watch.close()
            raise
    framing = LengthFraming(settings.max_answer_bytes, _TOO_LONG_HINT)
    patience = Patience(settings.step_timeout_s, _SILENCE_HINT)
    return Conversation(ByteStream(connection), framing, watch, patience), (host, port)


def _check(settings: ConnectionSettings) -> None:
    if settings.target is not None and settings.command is not None:
        raise ConfigError(
            "both target and command are given", hint="one of them says how the game starts"
        )
    if settings.engine_address[1] == 0 and not settings.is_ours:
        raise ConfigError(
            "engine_address has port 0, which only a game that we start can take",
            hint="give target or command, or the port at which the game listens",
        )


@contextmanager
def free_port(host: str) -> Generator[int]:
    """Yield a port that nobody uses, and that nobody gets who asks the system for one meanwhile.

    The port is bound, but never listened at: what a process that is just being started inherits
    cannot take the connections of the game. Linux lets a game listen beside such a socket, if both
    have the option ``SO_REUSEADDR``, which every Godot sets; elsewhere it is given up at once.
    """
    with socket.socket() as bound:
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        bound.bind((host, 0))
        port = bound.getsockname()[1]
        if sys.platform != "linux":
            bound.close()
        yield port


def check_port_is_free(address: tuple[str, int]) -> None:
    """Refuse to start a game where another one listens: we would talk with that.

    Raises:
        EngineStartError: Somebody listens there.
        ConfigError: It is not a port.
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
