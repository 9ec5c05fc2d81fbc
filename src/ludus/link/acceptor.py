"""Greet all clients of some sockets at the same time, and hand out the engines among them.

A client is a stranger until it has proved itself: it may be silent, a browser, another user's
program. No stranger keeps an engine waiting, and none is taken for one.
"""

from __future__ import annotations

import logging
import selectors
import socket
import time
from collections.abc import Callable, Sequence

from ludus.errors import LudusError
from ludus.link.peer import is_strangers
from ludus.link.pending_connection import PendingConnection
from ludus.wire.greeting import Greeting

__all__ = ["EngineAcceptor"]

MAX_PENDING = 64
"""With one more, the oldest is dropped: an engine proves itself at once."""
POLL_S = 0.1

log = logging.getLogger(__name__)


class EngineAcceptor:
    """Greets all clients of some listening sockets; for one thread.

    Args:
        listeners: Sockets that listen; closed with this object.
        new_greeting: Makes the greeting of each connection.
        timeout_s: Seconds within which an engine has to prove itself.

    Attributes:
        refusal: Why an engine was rejected last; None if none was.
    """

    def __init__(
        self,
        listeners: Sequence[socket.socket],
        new_greeting: Callable[[], Greeting],
        timeout_s: float,
    ) -> None:
        self.refusal: LudusError | None = None
        self._listeners = listeners
        self._new_greeting = new_greeting
        self._timeout_s = timeout_s
        self._pending: dict[PendingConnection, None] = {}  # oldest first
        self._selector = selectors.DefaultSelector()
        for listener in listeners:
            listener.setblocking(False)
            self._selector.register(listener, selectors.EVENT_READ)

    @property
    def num_pending(self) -> int:
        """How many clients have yet to prove themselves."""
        return len(self._pending)

    def await_proven(self, timeout_s: float = POLL_S) -> list[PendingConnection]:
        """Wait a moment; return those that have proved themselves, for the caller to close."""
        proven: list[PendingConnection] = []
        for key, _ in self._selector.select(timeout_s):
            if not isinstance(key.data, PendingConnection):
                self._accept(key.fileobj)
            elif key.data in self._pending and self._greet(key.data):
                self._remove(key.data)
                proven.append(key.data)
        self._reject_late()
        return proven

    def reject(self, connection: PendingConnection, error: LudusError, code: str = "") -> None:
        """Tell a client why it is rejected, and drop it a moment later."""
        log.warning("%s was rejected: %s", connection.name, error.message)
        if connection not in self._pending:
            self._add(connection)
        connection.reject(error, code)

    def close(self) -> None:
        """Stop listening, and drop all who have not proved themselves."""
        self._selector.close()
        for closing in (*self._listeners, *(connection.socket for connection in self._pending)):
            closing.close()
        self._pending.clear()

    def _accept(self, listener: object) -> None:
        assert isinstance(listener, socket.socket)
        try:
            accepted, address = listener.accept()
        except OSError as error:  # gone already, or too many files are open
            if not isinstance(error, BlockingIOError):
                log.warning("a connection could not be accepted: %s", error)
                time.sleep(POLL_S)
            return
        # A Unix socket of a client has no name.
        name = f"{address[0]}:{address[1]}" if address else "a game of this user"
        if is_strangers(accepted):
            log.warning("%s was dropped: it is another user's, or gone", name)
            accepted.close()
            return
        if len(self._pending) >= MAX_PENDING:
            oldest = next(iter(self._pending))
            log.warning("%s was dropped: %d newer clients are waiting", oldest.name, MAX_PENDING)
            self._drop(oldest)
        self._add(PendingConnection(accepted, name, self._new_greeting(), self._timeout_s))

    def _greet(self, connection: PendingConnection) -> bool:
        """Read on; return whether the client has proved itself."""
        try:
            is_here = connection.read()
        except LudusError as error:
            self._refuse(connection, error)
            return False
        except Exception:  # whatever it is, other games must still be able to connect
            log.exception("a defect of Ludus; %s was dropped", connection.name)
            is_here = False
        if not is_here:
            if not connection.is_rejected:
                log.warning("%s disconnected before it had proved itself", connection.name)
            self._drop(connection)
        return is_here and not connection.is_rejected and connection.greeting.is_over

    def _refuse(self, connection: PendingConnection, error: LudusError) -> None:
        if connection.greeting.hello is not None:
            self.refusal = error
        self.reject(connection, error)

    def _reject_late(self) -> None:
        for connection in list(self._pending):
            try:
                connection.check_deadline()
            except LudusError as error:
                if connection.is_rejected:
                    self._drop(connection)
                else:
                    self.reject(connection, error)

    def _add(self, connection: PendingConnection) -> None:
        self._selector.register(connection.socket, selectors.EVENT_READ, connection)
        self._pending[connection] = None

    def _remove(self, connection: PendingConnection) -> None:
        self._selector.unregister(connection.socket)
        del self._pending[connection]

    def _drop(self, connection: PendingConnection) -> None:
        self._remove(connection)
        connection.socket.close()
