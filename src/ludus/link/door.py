"""Let engines in: greet all who come at the same time, and hand out those that prove themselves.

Whoever connects is a stranger until then: silent ones, other users' programs, browsers. None keeps
an engine waiting, and none is taken for one.
"""

from __future__ import annotations

import logging
import selectors
import socket
import time
from collections.abc import Callable, Sequence

from ludus.errors import LudusError
from ludus.link.guest import Guest
from ludus.link.peer import is_strangers
from ludus.wire.greeting import Greeting

__all__ = ["Door"]

MAX_PENDING = 64
"""Where more are at the door, who has been there longest has to go: an engine takes no time."""
POLL_S = 0.1

log = logging.getLogger(__name__)


class Door:
    """Greets whoever connects to some listening sockets; for one thread.

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
        self._pending: dict[Guest, None] = {}  # oldest first
        self._selector = selectors.DefaultSelector()
        for listener in listeners:
            listener.setblocking(False)
            self._selector.register(listener, selectors.EVENT_READ)

    @property
    def num_pending(self) -> int:
        """How many are at the door."""
        return len(self._pending)

    def await_guests(self, timeout_s: float = POLL_S) -> list[Guest]:
        """Wait a moment; return those that have proved themselves, who are the caller's now."""
        proven: list[Guest] = []
        for key, _ in self._selector.select(timeout_s):
            if not isinstance(key.data, Guest):
                self._accept(key.fileobj)
            elif key.data in self._pending and self._greet(key.data):
                self._remove(key.data)
                proven.append(key.data)
        self._reject_late()
        return proven

    def reject(self, guest: Guest, error: LudusError, code: str = "") -> None:
        """Tell a guest why it may not come in, and drop it a moment later."""
        log.warning("%s was rejected: %s", guest.name, error.message)
        if guest not in self._pending:
            self._add(guest)
        guest.reject(error, code)

    def close(self) -> None:
        """Stop listening, and drop all who have not proved themselves."""
        self._selector.close()
        for closing in (*self._listeners, *(guest.socket for guest in self._pending)):
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
            log.warning("%s was dropped: %d others are at the door", oldest.name, MAX_PENDING)
            self._drop(oldest)
        self._add(Guest(accepted, name, self._new_greeting(), self._timeout_s))

    def _greet(self, guest: Guest) -> bool:
        """Read on; return whether the guest has proved itself."""
        try:
            is_here = guest.read()
        except LudusError as error:
            self._refuse(guest, error)
            return False
        except Exception:  # whatever it is, other games must still be able to connect
            log.exception("a defect of Ludus; %s was dropped", guest.name)
            is_here = False
        if not is_here:
            if not guest.is_rejected:
                log.warning("%s disconnected before it had proved itself", guest.name)
            self._drop(guest)
        return is_here and not guest.is_rejected and guest.greeting.is_over

    def _refuse(self, guest: Guest, error: LudusError) -> None:
        if guest.greeting.hello is not None:
            self.refusal = error
        self.reject(guest, error)

    def _reject_late(self) -> None:
        for guest in list(self._pending):
            try:
                guest.check_deadline()
            except LudusError as error:
                if guest.is_rejected:
                    self._drop(guest)
                else:
                    self.reject(guest, error)

    def _add(self, guest: Guest) -> None:
        self._selector.register(guest.socket, selectors.EVENT_READ, guest)
        self._pending[guest] = None

    def _remove(self, guest: Guest) -> None:
        self._selector.unregister(guest.socket)
        del self._pending[guest]

    def _drop(self, guest: Guest) -> None:
        self._remove(guest)
        guest.socket.close()
