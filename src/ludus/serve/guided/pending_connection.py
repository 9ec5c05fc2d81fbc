"""A connection that has yet to send its HELLO, or is being rejected."""

from __future__ import annotations

import contextlib
import select
import socket
import time

from ludus.errors import EngineTimeout, LudusError, ProtocolError
from ludus.wire.error_report import error_report
from ludus.wire.frames import (
    HEADER_BYTES,
    FrameType,
    decode_header,
    decode_json,
    encode_json,
)
from ludus.wire.handshake import Hello

__all__ = ["PendingConnection", "is_closed_by_peer"]

READ_BYTES = 1 << 16
LINGER_S = 1.0
"""How long a rejected client may go on sending."""


class PendingConnection:
    """A connection from which a ``HELLO`` is expected; never blocks.

    Args:
        connection: Open socket.
        name: Where it comes from, for the log.
        timeout_s: Seconds within which the whole ``HELLO`` has to come.

    Attributes:
        socket: The same socket.
        name: As given.
        received: Everything received so far.
        is_rejected: Whether it was rejected; it stays open for a moment so that it can read why.
    """

    def __init__(self, connection: socket.socket, name: str, timeout_s: float) -> None:
        connection.setblocking(False)
        self.socket = connection
        self.name = name
        self.received = bytearray()
        self.is_rejected = False
        self._timeout_s = timeout_s
        self._deadline = time.monotonic() + timeout_s

    def read(self) -> bool:
        """Read what has arrived; return False once the other side has disconnected."""
        try:
            data = self.socket.recv(READ_BYTES)
        except (BlockingIOError, InterruptedError):
            return True
        except OSError:
            return False
        if not self.is_rejected:
            self.received += data
        return bool(data)

    def hello(self) -> Hello | None:
        """Return the HELLO; None as long as it is incomplete.

        Raises:
            ProtocolError: The first frame is something else.
        """
        if len(self.received) < HEADER_BYTES:
            return None
        frame_type, num_bytes = decode_header(self.received[:HEADER_BYTES])
        if frame_type is not FrameType.HELLO:
            raise ProtocolError(f"the first frame must be HELLO, got {frame_type.name}")
        end = HEADER_BYTES + num_bytes
        if len(self.received) < end:
            return None
        return Hello.from_json(decode_json(self.received[HEADER_BYTES:end], "HELLO"))

    def check_deadline(self) -> None:
        """Check that the HELLO is not overdue.

        Raises:
            EngineTimeout: The deadline has passed.
        """
        if time.monotonic() > self._deadline:
            raise EngineTimeout(f"no complete HELLO arrived within {self._timeout_s:g} s")

    def reject(self, error: LudusError, code: str = "") -> None:
        """Tell the other side why, as far as it listens; nothing more is read as a HELLO."""
        report = error_report(error)
        if code:
            report["code"] = code
        self.is_rejected = True
        self._timeout_s = LINGER_S
        self._deadline = time.monotonic() + LINGER_S
        with contextlib.suppress(OSError):
            self.socket.send(encode_json(FrameType.ERROR, report))
            # Closing at once, with unread data, would destroy what was sent.
            self.socket.shutdown(socket.SHUT_WR)


def is_closed_by_peer(connection: socket.socket) -> bool:
    """Return whether the other side has closed a connection, even if data is still unread.

    Return False where the system cannot tell.
    """
    number = connection.fileno()
    if number < 0:
        return True
    if not hasattr(select, "poll"):
        return False
    poll = select.poll()
    poll.register(number, getattr(select, "POLLRDHUP", 0))
    return bool(poll.poll(0))
