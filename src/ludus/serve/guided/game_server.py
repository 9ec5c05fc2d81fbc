"""Accept games for ``ludus serve``: one at a time; others are rejected and told why.

Connections are handled in a separate thread, so that they do not disturb the game that is being
trained. The thread sleeps while there are none.
"""

from __future__ import annotations

import logging
import selectors
import socket
import threading
import time
from dataclasses import dataclass

from ludus.errors import LudusError, ProtocolError, SetupError
from ludus.link import Link, listen_tcp
from ludus.serve.guided.pending_connection import PendingConnection, is_closed_by_peer
from ludus.wire.handshake import Hello
from ludus.wire.training import Training, read_training

__all__ = ["ConnectedGame", "GameServer"]

POLL_S = 0.1
MAX_PENDING = 64
"""More at once are dropped."""
BACKLOG = 2 * MAX_PENDING
"""A client that does not fit into this queue connects a second later, when TCP tries again."""
RELEASE_WAIT_S = 1.0
"""How long a game waits for the current one to go. A game that restarts connects again at once, and
its new connection can be seen before the end of the old one: by milliseconds on Linux, by more
where :func:`is_closed_by_peer` cannot tell."""

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class ConnectedGame:
    """A game that has sent its HELLO.

    Attributes:
        link: The connection; the HELLO is still to be read from it.
        hello: That HELLO.
        training: How the game wants to be trained.
        name: Where it comes from.
    """

    link: Link
    hello: Hello
    training: Training
    name: str


@dataclass(frozen=True)
class _WaitingGame:
    """A game that has sent its HELLO and waits, until ``deadline``, for the current one to go."""

    connection: PendingConnection
    hello: Hello
    training: Training
    deadline: float


class GameServer:
    """Listens from the start; accepts games while it is entered as a context.

    Args:
        port: TCP port on the loopback address; 0 takes a free one.
        hello_timeout_s: How long a HELLO may take.
        link_timeout_s: Deadline of the link of an accepted game.

    Attributes:
        port: Where it listens.

    Raises:
        SetupError: The port is taken, or may not be used.
    """

    def __init__(self, port: int, hello_timeout_s: float, link_timeout_s: float) -> None:
        self._socket = _listen(port)
        self.port = int(self._socket.getsockname()[1])
        self._hello_timeout_s = hello_timeout_s
        self._link_timeout_s = link_timeout_s
        self._pending: set[PendingConnection] = set()
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
        with self._socket, selectors.DefaultSelector() as selector:
            selector.register(self._socket, selectors.EVENT_READ)
            while not self._is_closing.is_set():
                for key, _ in selector.select(POLL_S):
                    if isinstance(key.data, PendingConnection):
                        self._handle(selector, key.data)
                    else:
                        self._accept(selector)
                self._settle_waiting(selector)
                self._reject_late(selector)
            for connection in [*self._pending, *(game.connection for game in self._waiting)]:
                connection.socket.close()

    def _accept(self, selector: selectors.BaseSelector) -> None:
        try:
            accepted, address = self._socket.accept()
        except OSError as error:  # gone already, or too many files are open
            log.warning("a connection could not be accepted: %s", error)
            time.sleep(POLL_S)
            return
        if len(self._pending) + len(self._waiting) >= MAX_PENDING:
            log.warning("a connection was dropped: %d others are pending", MAX_PENDING)
            accepted.close()
            return
        name = f"{address[0]}:{address[1]}"
        self._watch(selector, PendingConnection(accepted, name, self._hello_timeout_s))

    def _handle(self, selector: selectors.BaseSelector, connection: PendingConnection) -> None:
        try:
            self._read(selector, connection)
        except Exception:  # whatever it is, other games must still be able to connect
            log.exception("a defect of ludus serve; %s was dropped", connection.name)
            if connection in self._pending:
                self._drop(selector, connection)

    def _read(self, selector: selectors.BaseSelector, connection: PendingConnection) -> None:
        if not connection.read():
            if not connection.is_rejected:
                log.warning("%s disconnected without a HELLO", connection.name)
            self._drop(selector, connection)
            return
        if connection.is_rejected:
            return
        try:
            hello = connection.hello()
        except LudusError as error:
            self._reject(connection, error)
            return
        if hello is not None:
            self._wait(selector, connection, hello)

    def _wait(
        self, selector: selectors.BaseSelector, connection: PendingConnection, hello: Hello
    ) -> None:
        try:
            training = Training() if hello.training is None else read_training(hello.training)
        except ProtocolError as error:
            self._reject(connection, error, "config")
            return
        self._unwatch(selector, connection)
        deadline = time.monotonic() + RELEASE_WAIT_S
        self._waiting.append(_WaitingGame(connection, hello, training, deadline))

    def _settle_waiting(self, selector: selectors.BaseSelector) -> None:
        for game in list(self._waiting):
            try:
                if not self._settle(selector, game):
                    continue
            except Exception:
                log.exception("a defect of ludus serve; %s was dropped", game.connection.name)
                game.connection.socket.close()
            self._waiting.remove(game)

    def _settle(self, selector: selectors.BaseSelector, game: _WaitingGame) -> bool:
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
        self._watch(selector, connection)
        self._reject(connection, SetupError("another game is being trained", hint), "busy")
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
            self._next = ConnectedGame(link, game.hello, game.training, connection.name)
            self._changed.notify_all()
            return True

    def _is_busy(self) -> bool:
        """Return whether there is a game; one that has disconnected does not count."""
        games = (self._current, self._next)
        return any(one is not None and not is_closed_by_peer(one.link.socket) for one in games)

    def _reject(self, connection: PendingConnection, error: LudusError, code: str = "") -> None:
        log.warning("%s was rejected: %s", connection.name, error.message)
        connection.reject(error, code)

    def _reject_late(self, selector: selectors.BaseSelector) -> None:
        for connection in list(self._pending):
            try:
                connection.check_deadline()
            except LudusError as error:
                if connection.is_rejected:
                    self._drop(selector, connection)
                else:
                    self._reject(connection, error)

    def _watch(self, selector: selectors.BaseSelector, connection: PendingConnection) -> None:
        selector.register(connection.socket, selectors.EVENT_READ, connection)
        self._pending.add(connection)

    def _unwatch(self, selector: selectors.BaseSelector, connection: PendingConnection) -> None:
        selector.unregister(connection.socket)
        self._pending.discard(connection)

    def _drop(self, selector: selectors.BaseSelector, connection: PendingConnection) -> None:
        self._unwatch(selector, connection)
        connection.socket.close()


def _listen(port: int) -> socket.socket:
    try:
        listener = listen_tcp(("127.0.0.1", port), BACKLOG)
    except (OSError, OverflowError) as error:
        raise SetupError(
            f"cannot listen at 127.0.0.1:{port}: {error}",
            "another ludus serve or ludus train is there; end it, or choose another --port",
        ) from error
    listener.setblocking(False)
    return listener
