"""Accept games for ``ludus serve``: one at a time; others are rejected and told why.

Connections are handled in a separate thread, so that they do not disturb the game that is being
trained. The thread sleeps while there are none.
"""

from __future__ import annotations

import logging
import socket
import threading
import time
from contextlib import closing
from dataclasses import dataclass

from ludus.errors import ProtocolError, SetupError
from ludus.link import (
    BACKLOG,
    EngineAcceptor,
    Link,
    PendingConnection,
    is_closed_by_peer,
    listen_tcp,
)
from ludus.wire.greeting import Greeting
from ludus.wire.training import Training, read_training

__all__ = ["ConnectedGame", "GameServer"]

POLL_S = 0.1
RELEASE_WAIT_S = 1.0
"""How long a game waits for the current one to go. A game that restarts connects again at once, and
its new connection can be seen before the end of the old one: by milliseconds on Linux, by more
where :func:`is_closed_by_peer` cannot tell."""

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class ConnectedGame:
    """A game that has proved itself.

    Attributes:
        link: The connection.
        greeting: What was said on it.
        training: How the game wants to be trained.
        name: Where it comes from.
    """

    link: Link
    greeting: Greeting
    training: Training
    name: str


@dataclass(frozen=True)
class _WaitingGame:
    """A game that has proved itself and waits, until ``deadline``, for the current one to go."""

    connection: PendingConnection
    training: Training
    deadline: float


class GameServer:
    """Listens from the start; accepts games while it is entered as a context.

    Args:
        port: TCP port on the loopback address; 0 takes a free one.
        token: The secret that games know.
        hello_timeout_s: How long a greeting may take.
        link_timeout_s: Deadline of the link of an accepted game.

    Attributes:
        port: Where it listens.

    Raises:
        SetupError: The port is taken, or may not be used.
    """

    def __init__(
        self, port: int, token: str, hello_timeout_s: float, link_timeout_s: float
    ) -> None:
        listener = _listen(port)
        self.port = int(listener.getsockname()[1])
        self._acceptor = EngineAcceptor([listener], lambda: Greeting(token), hello_timeout_s)
        self._link_timeout_s = link_timeout_s
        self._waiting: list[_WaitingGame] = []
        self._is_closing = threading.Event()
        self._changed = threading.Condition()
        self._next: ConnectedGame | None = None
        self._current: ConnectedGame | None = None
        self._thread = threading.Thread(target=self._run, name="game-server", daemon=True)

    def __enter__(self) -> GameServer:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._is_closing.set()
        self._thread.join()
        if self._next is not None:
            self._next.link.close()

    def accept(self, timeout_s: float) -> ConnectedGame | None:
        """Wait for a game and return it; None if none connected in time.

        Other games are rejected until :meth:`release`.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._next is not None, timeout_s)
            self._current, self._next = self._next, None
            return self._current

    def release(self) -> None:
        """Note that the accepted game has gone, so that another can be accepted."""
        with self._changed:
            self._current = None

    def _run(self) -> None:
        with closing(self._acceptor):
            while not self._is_closing.is_set():
                for connection in self._acceptor.await_proven(POLL_S):
                    self._wait(connection)
                self._settle_waiting()
        for game in self._waiting:
            game.connection.socket.close()

    def _wait(self, connection: PendingConnection) -> None:
        hello = connection.greeting.hello
        assert hello is not None, "it has proved itself"
        try:
            training = Training() if hello.training is None else read_training(hello.training)
        except ProtocolError as error:
            self._acceptor.reject(connection, error, "config")
            return
        self._waiting.append(_WaitingGame(connection, training, time.monotonic() + RELEASE_WAIT_S))

    def _settle_waiting(self) -> None:
        for game in list(self._waiting):
            try:
                if not self._settle(game):
                    continue
            except Exception:
                log.exception("a defect of ludus serve; %s was dropped", game.connection.name)
                game.connection.socket.close()
            self._waiting.remove(game)

    def _settle(self, game: _WaitingGame) -> bool:
        """Accept, drop or reject a game; return False if it has to go on waiting."""
        connection = game.connection
        if is_closed_by_peer(connection.socket):
            log.warning("%s disconnected before it could be accepted", connection.name)
            connection.socket.close()
            return True
        if self._accept_game(game):
            return True
        if time.monotonic() <= game.deadline:
            return False
        hint = "wait until it has ended, or start another ludus serve at another --port"
        self._acceptor.reject(connection, SetupError("another game is being trained", hint), "busy")
        return True

    def _accept_game(self, game: _WaitingGame) -> bool:
        """Accept a game unless there is one; return whether it was accepted."""
        with self._changed:
            if self._is_busy():
                return False
            if self._next is not None:
                self._next.link.close()
            connection = game.connection
            link = Link(connection.socket, self._link_timeout_s, bytes(connection.received))
            self._next = ConnectedGame(link, connection.greeting, game.training, connection.name)
            self._changed.notify_all()
            return True

    def _is_busy(self) -> bool:
        """Return whether there is a game; one that has disconnected does not count."""
        games = (self._current, self._next)
        return any(one is not None and not is_closed_by_peer(one.link.socket) for one in games)


def _listen(port: int) -> socket.socket:
    try:
        listener = listen_tcp(("127.0.0.1", port), BACKLOG)
    except (OSError, OverflowError) as error:
        raise SetupError(
            f"cannot listen at 127.0.0.1:{port}: {error}",
            "another ludus serve or ludus train is there; end it, or choose another --port",
        ) from error
    return listener
