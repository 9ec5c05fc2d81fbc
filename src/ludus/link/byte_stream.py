"""A TCP connection that carries bytes, with deadlines: for wires that are not Ludus's own."""

from __future__ import annotations

import select
import socket
import struct
import sys
import time
from collections.abc import Callable

from ludus.errors import EngineStartError, EngineTimeout
from ludus.link.busy_poller import BusyPoller
from ludus.link.peer import listener_is_strangers
from ludus.link.sockets import LinkClosed, is_loopback

__all__ = ["ByteStream", "connect_until", "refuse_stranger"]

_READ_BYTES = 1 << 16
_POLL_S = 0.25
_RETRY_S = 0.05
_HAS_RECEIVE_LIMIT = sys.platform != "win32"
"""Whether a socket may wait for a limited time: on Windows it is of no use afterwards."""

Check = Callable[[], None]


class ByteStream:
    """One connection with a peer that may be slow, silent or gone.

    Without a busy poller, the socket itself waits, for :data:`_POLL_S` at most: one system call
    instead of the two that a Python timeout takes.

    Args:
        connection: Open socket; closed with this object.
        peer: What the other side is called in messages.
        spin_s: How long to poll for bytes before blocking, seconds; see
            :class:`~ludus.link.busy_poller.BusyPoller`.
    """

    def __init__(
        self, connection: socket.socket, peer: str = "the game", spin_s: float = 0.0
    ) -> None:
        self.peer = peer
        self._socket = connection
        self._await_bytes = _waiter(connection)
        self._poller = BusyPoller(connection, spin_s) if spin_s > 0.0 else None
        self._view = memoryview(bytearray(_READ_BYTES if self._poller else 0))
        # The poller's handle shares the file's flags: its non-blocking mode holds here, too.
        self._waits_itself = _HAS_RECEIVE_LIMIT and self._poller is None
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._limit_waits()

    def send(self, data: bytes, timeout_s: float) -> None:
        """Send all of ``data``.

        Raises:
            LinkClosed: The peer has gone.
            EngineTimeout: It does not read.
        """
        try:
            num_bytes = self._send_at_once(data)
            if num_bytes < len(data):
                self._socket.settimeout(timeout_s)
                try:
                    self._socket.sendall(data[num_bytes:])
                finally:
                    self._limit_waits()
        except TimeoutError as error:
            raise EngineTimeout(f"{self.peer} read nothing for {timeout_s:g} s") from error
        except OSError as error:
            raise LinkClosed(f"{self.peer} has gone: {error}") from error

    def receive(self, deadline: float, check: Check) -> bytes:
        """Return the bytes that come next, at least one.

        Args:
            deadline: On the clock of ``time.monotonic``, seconds.
            check: Called about four times a second; raises if waiting has become pointless.

        Raises:
            LinkClosed: The peer has gone.
            EngineTimeout: Nothing came in time.
        """
        try:
            while (left_s := deadline - time.monotonic()) > 0.0:
                data = self._receive_once(left_s)
                if data is None:
                    check()
                elif data:
                    return data
                else:
                    raise LinkClosed(f"{self.peer} closed the connection")
        except OSError as error:
            raise LinkClosed(f"{self.peer} has gone: {error}") from error
        raise EngineTimeout("no answer came in time")

    def is_readable(self) -> bool:
        """Return whether bytes have come, or the peer has closed the connection."""
        return self._await_bytes(0.0)

    def shut_down(self) -> None:
        """Tell the peer that nothing more is sent.

        Raises:
            OSError: It has gone.
        """
        self._socket.shutdown(socket.SHUT_WR)

    def close(self) -> None:
        """Close the connection; may be called twice."""
        if self._poller is not None:
            self._poller.close()
        self._socket.close()

    def _receive_once(self, left_s: float) -> bytes | None:
        """Return what came, ``b""`` at the end of the stream, None if nothing came."""
        if self._poller is not None and (count := self._poller.read(self._view)) is not None:
            return bytes(self._view[:count])
        waits_itself = self._waits_itself and left_s >= _POLL_S
        if not waits_itself and not self._await_bytes(min(left_s, _POLL_S)):
            return None
        try:
            return self._socket.recv(_READ_BYTES)
        except BlockingIOError:
            return None

    def _send_at_once(self, data: bytes) -> int:
        try:
            return self._socket.send(data)
        except BlockingIOError:
            return 0

    def _limit_waits(self) -> None:
        """Let the socket wait for `_POLL_S` at most, or not at all; then BlockingIOError comes."""
        self._socket.setblocking(self._waits_itself)
        if self._waits_itself:
            limit = struct.pack("@ll", 0, int(_POLL_S * 1e6))
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, limit)
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, limit)


def _waiter(connection: socket.socket) -> Callable[[float], bool]:
    """Return what waits up to so many seconds for bytes or an end, and says whether any came."""
    if sys.platform == "win32":
        return lambda timeout_s: bool(select.select([connection], [], [], timeout_s)[0])
    poll = select.poll()  # `select` knows no more than 1024 files, `selectors` are slower
    poll.register(connection, select.POLLIN)
    return lambda timeout_s: bool(poll.poll(timeout_s * 1000.0))


def connect_until(address: tuple[str, int], timeout_s: float, check: Check) -> socket.socket:
    """Connect, again and again until somebody listens.

    Args:
        address: Host and port.
        timeout_s: Longest wait, seconds; with 0 there is one try.
        check: Called before each try; raises if waiting has become pointless.

    Raises:
        EngineTimeout: Nothing listened there in time.
    """
    deadline = time.monotonic() + timeout_s
    while True:
        check()
        left_s = deadline - time.monotonic()
        try:
            return socket.create_connection(address, max(left_s, _RETRY_S))
        except OSError as error:
            if left_s <= 0.0:
                host, port = address
                raise EngineTimeout(
                    f"no game listened at {host}:{port} within {timeout_s:g} s ({error})"
                ) from error
            time.sleep(min(_RETRY_S, left_s))


def refuse_stranger(address: tuple[str, int]) -> None:
    """Check that it is a program of this user that listens at an address of this machine.

    Raises:
        EngineStartError: It is another user's, and the system tells so.
    """
    host, port = address
    if is_loopback(host) and listener_is_strangers(port):
        raise EngineStartError(
            f"what listens at {host}:{port} is another user's program",
            hint="choose another port, or have that program ended",
        )
