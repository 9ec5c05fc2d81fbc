"""The door of ``ludus serve``: one game may come in, all others are told why they may not.

It works in a thread of its own, so that nobody who knocks disturbs the game that is being trained,
and sleeps while nobody does.
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
from ludus.serve.guided.guest import Guest, has_hung_up
from ludus.wire.handshake import Hello
from ludus.wire.training import Training, read_training

__all__ = ["Door", "Visitor"]

POLL_S = 0.1
MAX_GUESTS = 64
"""More at once are dropped."""
BACKLOG = 2 * MAX_GUESTS
"""Whoever finds no room here tries again a second later, and only then is dropped or let in."""
PATIENCE_S = 1.0
"""How long a game waits for the one inside to go: that it has hung up can be known later than that
somebody knocks, by milliseconds on Linux, and where :func:`has_hung_up` cannot tell by more."""

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Visitor:
    """A game that has greeted.

    Attributes:
        link: The connection; the greeting comes first.
        hello: What that says.
        training: How the game wants to be trained.
        name: Where it comes from.
    """

    link: Link
    hello: Hello
    training: Training
    name: str


@dataclass(frozen=True)
class _Caller:
    """A guest that has greeted, and may come in until ``deadline`` if there is room."""

    guest: Guest
    hello: Hello
    training: Training
    deadline: float


class Door:
    """Listens from the start; lets games in while it is entered as a context.

    Args:
        port: TCP port on the loopback address; 0 takes a free one.
        hello_timeout_s: How long a greeting may take.
        link_timeout_s: Deadline of the link of a game that comes in.

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
        self._guests: set[Guest] = set()
        self._callers: list[_Caller] = []
        self._is_closing = threading.Event()
        self._has_come = threading.Condition()
        self._next: Visitor | None = None
        self._inside: Visitor | None = None
        self._thread = threading.Thread(target=self._run, name="door", daemon=True)

    def __enter__(self) -> Door:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._is_closing.set()
        self._thread.join()
        if self._next is not None:
            self._next.link.close()

    def let_in(self, timeout_s: float) -> Visitor | None:
        """Wait for a game; None if none has come in time.

        Others are turned away until :meth:`let_out`.
        """
        with self._has_come:
            self._has_come.wait_for(lambda: self._next is not None, timeout_s)
            self._inside, self._next = self._next, None
            return self._inside

    def let_out(self) -> None:
        """Note that the game that was let in has gone."""
        with self._has_come:
            self._inside = None

    def _run(self) -> None:
        with self._socket, selectors.DefaultSelector() as selector:
            selector.register(self._socket, selectors.EVENT_READ)
            while not self._is_closing.is_set():
                for key, _ in selector.select(POLL_S):
                    if isinstance(key.data, Guest):
                        self._attend(selector, key.data)
                    else:
                        self._accept(selector)
                self._attend_callers(selector)
                self._drop_the_late(selector)
            for guest in [*self._guests, *(caller.guest for caller in self._callers)]:
                guest.socket.close()

    def _accept(self, selector: selectors.BaseSelector) -> None:
        try:
            connection, address = self._socket.accept()
        except OSError as error:  # gone already, or too many files are open
            log.warning("a connection could not be accepted: %s", error)
            time.sleep(POLL_S)
            return
        if len(self._guests) + len(self._callers) >= MAX_GUESTS:
            log.warning("a connection was dropped: %d others are at the door", MAX_GUESTS)
            connection.close()
            return
        guest = Guest(connection, f"{address[0]}:{address[1]}", self._hello_timeout_s)
        self._listen_to(selector, guest)

    def _attend(self, selector: selectors.BaseSelector, guest: Guest) -> None:
        try:
            self._hear(selector, guest)
        except Exception:  # whatever it is, the door must stay open
            log.exception("a defect of ludus serve; %s was dropped", guest.name)
            if guest in self._guests:
                self._drop(selector, guest)

    def _hear(self, selector: selectors.BaseSelector, guest: Guest) -> None:
        if not guest.hear():
            if not guest.is_leaving:
                log.warning("%s has left without a greeting", guest.name)
            self._drop(selector, guest)
            return
        if guest.is_leaving:
            return
        try:
            hello = guest.greeting()
        except LudusError as error:
            self._turn_away(guest, error)
            return
        if hello is not None:
            self._call(selector, guest, hello)

    def _call(self, selector: selectors.BaseSelector, guest: Guest, hello: Hello) -> None:
        try:
            training = Training() if hello.training is None else read_training(hello.training)
        except ProtocolError as error:
            self._turn_away(guest, error, "config")
            return
        self._forget(selector, guest)
        deadline = time.monotonic() + PATIENCE_S
        self._callers.append(_Caller(guest, hello, training, deadline))

    def _attend_callers(self, selector: selectors.BaseSelector) -> None:
        for caller in list(self._callers):
            try:
                if not self._settle(selector, caller):
                    continue
            except Exception:
                log.exception("a defect of ludus serve; %s was dropped", caller.guest.name)
                caller.guest.socket.close()
            self._callers.remove(caller)

    def _settle(self, selector: selectors.BaseSelector, caller: _Caller) -> bool:
        """Let a caller in, drop it or turn it away; return False if it has to wait on."""
        guest = caller.guest
        if has_hung_up(guest.socket):
            log.warning("%s has left before it could come in", guest.name)
            guest.socket.close()
            return True
        if self._admit(caller):
            return True
        if time.monotonic() <= caller.deadline:
            return False
        hint = "wait until it has ended, or start another ludus serve at another --port"
        self._listen_to(selector, guest)
        self._turn_away(guest, SetupError("another game is being trained", hint), "busy")
        return True

    def _admit(self, caller: _Caller) -> bool:
        """Let a caller in if there is room; return whether there is."""
        with self._has_come:
            if self._is_taken():
                return False
            if self._next is not None:
                self._next.link.close()
            guest = caller.guest
            link = Link(guest.socket, self._link_timeout_s, bytes(guest.received))
            self._next = Visitor(link, caller.hello, caller.training, guest.name)
            self._has_come.notify_all()
            return True

    def _is_taken(self) -> bool:
        """Return whether there is a game; one that has hung up, unnoticed so far, is none."""
        visitors = (self._inside, self._next)
        return any(one is not None and not has_hung_up(one.link.socket) for one in visitors)

    def _turn_away(self, guest: Guest, error: LudusError, code: str = "") -> None:
        log.warning("%s was turned away: %s", guest.name, error.message)
        guest.turn_away(error, code)

    def _drop_the_late(self, selector: selectors.BaseSelector) -> None:
        for guest in list(self._guests):
            try:
                guest.check_time()
            except LudusError as error:
                if guest.is_leaving:
                    self._drop(selector, guest)
                else:
                    self._turn_away(guest, error)

    def _listen_to(self, selector: selectors.BaseSelector, guest: Guest) -> None:
        selector.register(guest.socket, selectors.EVENT_READ, guest)
        self._guests.add(guest)

    def _forget(self, selector: selectors.BaseSelector, guest: Guest) -> None:
        selector.unregister(guest.socket)
        self._guests.discard(guest)

    def _drop(self, selector: selectors.BaseSelector, guest: Guest) -> None:
        self._forget(selector, guest)
        guest.socket.close()


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
