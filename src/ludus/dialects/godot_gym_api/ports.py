"""Ports at which a game shall listen."""

from __future__ import annotations

import socket

from ludus.errors import ConfigError, EngineStartError

__all__ = ["check_port_is_free", "free_port"]

_MAX_PORT = 65535


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
