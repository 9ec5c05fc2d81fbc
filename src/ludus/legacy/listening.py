"""Wait until a game connects, for bridges in which Python is the server."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable
from typing import Protocol, TypeVar

from ludus.errors import EngineStartError, EngineTimeout, ProtocolError
from ludus.legacy.launching import GameWatch
from ludus.link import ByteStream, LinkClosed, is_strangers, listen_tcp

__all__ = ["Candidate", "await_game", "listen"]

_POLL_S = 0.01
_MAX_PENDING = 64
"""With one more, the oldest is dropped: a game introduces itself at once."""


class Candidate(Protocol):
    """A client that has yet to show that it is a game."""

    @property
    def stream(self) -> ByteStream:
        """Its connection."""
        ...

    def is_game(self, check: Callable[[], None]) -> bool:
        """Take in what has come, without waiting; return whether it is a game.

        Args:
            check: Raises if the game that we started has ended.

        Raises:
            ProtocolError: It is something else.
            EngineTimeout: It took too long.
            LinkClosed: It has hung up.
        """
        ...


Found = TypeVar("Found", bound=Candidate)


def listen(address: tuple[str, int], hint: str) -> socket.socket:
    """Return a socket at which games can connect.

    Args:
        address: Host and port; port 0 takes a free one.
        hint: What to do about a taken port.

    Raises:
        EngineStartError: The port is taken.
    """
    try:
        return listen_tcp(address)
    except OSError as error:
        host, port = address
        raise EngineStartError(
            f"cannot wait for a game at {host}:{port}: {error.strerror or error}", hint=hint
        ) from error


def await_game(
    listener: socket.socket,
    timeout_s: float,
    watch: GameWatch,
    receive: Callable[[ByteStream], Found],
    hint: str,
) -> Found:
    """Wait for a game; other clients are disconnected, and none keeps the game waiting.

    Args:
        listener: What :func:`listen` returned.
        timeout_s: How long it may take, seconds.
        watch: The game's process, if it is ours.
        receive: Makes a candidate of a new connection.
        hint: What to do if none comes.

    Raises:
        EngineStartError: No game connected in time.
        EngineCrashed: The game that we started has ended.
    """
    deadline = time.monotonic() + timeout_s
    refused = ""
    pending: list[Found] = []
    listener.setblocking(False)
    try:
        while time.monotonic() < deadline:
            watch.check_alive()
            refused = _accept(listener, receive, pending) or refused
            for client in list(pending):
                try:
                    if client.is_game(watch.check_alive):
                        pending.remove(client)
                        return client
                except (ProtocolError, EngineTimeout, LinkClosed) as error:
                    refused = f"; what did connect was no game: {error}"
                    pending.remove(client)
                    client.stream.close()
            time.sleep(_POLL_S)
    finally:
        for client in pending:
            client.stream.close()
    host, port = listener.getsockname()[:2]
    raise EngineStartError(
        f"no game connected within {timeout_s:g} s{refused} at {host}:{port}{watch.report()}",
        hint=hint,
    )


def _accept(
    listener: socket.socket, receive: Callable[[ByteStream], Found], pending: list[Found]
) -> str:
    """Accept a client, if there is one; return why it was rejected, if it was."""
    try:
        connection, _ = listener.accept()
    except (BlockingIOError, ConnectionError):
        return ""
    except OSError as error:  # too many files are open
        return f"; a connection could not be accepted: {error.strerror}"
    if is_strangers(connection):
        connection.close()
        return "; what did connect was another user's program"
    stream = ByteStream(connection)
    try:
        pending.append(receive(stream))
    except (LinkClosed, EngineTimeout) as error:
        stream.close()
        return f"; what did connect was no game: {error}"
    if len(pending) > _MAX_PENDING:
        pending.pop(0).stream.close()
    return ""
