"""One connection at the door: it has to greet in time, and is told why it may not stay."""

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

__all__ = ["Guest", "has_hung_up"]

READ_BYTES = 1 << 16
LINGER_S = 1.0
"""How long a guest that is turned away may go on sending."""


class Guest:
    """A connection from which a ``HELLO`` is expected; never blocks.

    Args:
        connection: Open socket.
        name: Where it comes from, for the log.
        timeout_s: Seconds within which the whole ``HELLO`` has to come.

    Attributes:
        socket: The same socket.
        name: As given.
        received: All that came so far.
        is_leaving: Whether it was turned away, and is only listened to so that it can read why.
    """

    def __init__(self, connection: socket.socket, name: str, timeout_s: float) -> None:
        connection.setblocking(False)
        self.socket = connection
        self.name = name
        self.received = bytearray()
        self.is_leaving = False
        self._timeout_s = timeout_s
        self._deadline = time.monotonic() + timeout_s

    def hear(self) -> bool:
        """Read what has come; return whether the guest is still there."""
        try:
            data = self.socket.recv(READ_BYTES)
        except (BlockingIOError, InterruptedError):
            return True
        except OSError:
            return False
        if not self.is_leaving:
            self.received += data
        return bool(data)

    def greeting(self) -> Hello | None:
        """Return the greeting; None as long as it has not come whole.

        Raises:
            ProtocolError: Something else came.
        """
        if len(self.received) < HEADER_BYTES:
            return None
        frame_type, num_bytes = decode_header(self.received[:HEADER_BYTES])
        if frame_type is not FrameType.HELLO:
            raise ProtocolError(f"a game begins with HELLO, {frame_type.name} came")
        end = HEADER_BYTES + num_bytes
        if len(self.received) < end:
            return None
        return Hello.from_json(decode_json(self.received[HEADER_BYTES:end], "HELLO"))

    def check_time(self) -> None:
        """Refuse a guest that takes too long.

        Raises:
            EngineTimeout: The deadline has passed.
        """
        if time.monotonic() > self._deadline:
            raise EngineTimeout(f"no whole HELLO came within {self._timeout_s:g} s")

    def turn_away(self, error: LudusError, code: str = "") -> None:
        """Tell the guest why it may not stay, if it listens."""
        report = error_report(error)
        if code:
            report["code"] = code
        self.is_leaving = True
        self._timeout_s = LINGER_S
        self._deadline = time.monotonic() + LINGER_S
        with contextlib.suppress(OSError):
            self.socket.send(encode_json(FrameType.ERROR, report))
            # Closing at once, with unread data, would destroy what was sent.
            self.socket.shutdown(socket.SHUT_WR)


def has_hung_up(connection: socket.socket) -> bool:
    """Return whether the other side has closed a connection, whatever is still to be read of it.

    Where the system cannot tell, it has not.
    """
    number = connection.fileno()
    if number < 0:
        return True
    if not hasattr(select, "poll"):
        return False
    poll = select.poll()
    poll.register(number, getattr(select, "POLLRDHUP", 0))
    return bool(poll.poll(0))
