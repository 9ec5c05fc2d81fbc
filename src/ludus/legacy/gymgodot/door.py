"""Wait at an address until a game connects; Python is the server here."""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Callable

from ludus.errors import EngineStartError, EngineTimeout, ProtocolError
from ludus.legacy.gymgodot.web_socket import WebSocket
from ludus.link import LinkClosed

__all__ = ["Door"]

_POLL_S = 0.1
_HANDSHAKE_S = 5.0
_BACKLOG = 16


class Door:
    """A listening socket.

    Args:
        host: Address to listen at.
        port: Port; 0 takes a free one.

    Raises:
        EngineStartError: Somebody listens there already, or the address is not of this machine.
    """

    def __init__(self, host: str, port: int) -> None:
        self._listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        if os.name == "posix":  # elsewhere it would take the port away from somebody
            self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            self._listener.bind((host, port))
            self._listener.listen(_BACKLOG)
        except OSError as error:
            self._listener.close()
            raise EngineStartError(
                f"cannot wait for a game at {host}:{port}: {error.strerror or error}",
                hint="close the environment that uses this port, or choose another serverPort "
                "(0 takes a free one)",
            ) from error
        self.port: int = self._listener.getsockname()[1]
        self._refused: list[str] = []

    def accept(
        self, timeout_s: float, max_message_bytes: int, check: Callable[[], None]
    ) -> WebSocket:
        """Wait for a game. Whoever connects and is none is sent away.

        Args:
            timeout_s: Longest wait, seconds.
            max_message_bytes: Longest message that the game may send.
            check: Called ten times a second; raises if waiting has become pointless.

        Raises:
            EngineTimeout: No game connected in time; the text says who else did.
        """
        deadline = time.monotonic() + timeout_s
        while time.monotonic() < deadline:
            connection = self._next(check)
            if connection is not None:
                link = WebSocket(connection, max_message_bytes)
                if self._greet(link, min(deadline, time.monotonic() + _HANDSHAKE_S), check):
                    return link
        others = f"; {self._refused[-1]}" if self._refused else ""
        raise EngineTimeout(f"no game connected within {timeout_s:g} s{others}")

    def close(self) -> None:
        """Stop waiting; may be called twice."""
        self._listener.close()

    def _next(self, check: Callable[[], None]) -> socket.socket | None:
        check()
        self._listener.settimeout(_POLL_S)
        try:
            return self._listener.accept()[0]
        except (TimeoutError, ConnectionError):
            return None

    def _greet(self, link: WebSocket, deadline: float, check: Callable[[], None]) -> bool:
        try:
            link.shake_hands(deadline, check)
        except (ProtocolError, EngineTimeout, LinkClosed) as error:
            self._refused = [f"what did connect was no game: {error}"]
            link.close()
            return False
        except BaseException:
            link.close()
            raise
        return True
