"""Ports at which a game shall listen."""

from __future__ import annotations

import socket
import sys
from collections.abc import Generator
from contextlib import contextmanager

from ludus.errors import ConfigError, EngineStartError

__all__ = ["check_port_is_free", "free_port"]

_MAX_PORT = 65535


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
