"""A connection whose engine has yet to prove itself, or is being rejected."""

from __future__ import annotations

import contextlib
import select
import socket
import time

from ludus.errors import EngineTimeout, LudusError
from ludus.wire.error_report import error_report
from ludus.wire.frames import (
    HEADER_BYTES,
    FrameType,
    decode_header,
    encode_json,
)
from ludus.wire.greeting import Greeting

__all__ = ["PendingConnection", "is_closed_by_peer"]

READ_BYTES = 1 << 16
LINGER_S = 1.0
"""How long a rejected client may go on sending."""
_ENDINGS = (FrameType.ERROR, FrameType.CLOSE)


class PendingConnection:
    """One connection, as far as the greeting goes; never blocks.

    Args:
        connection: Open socket.
        name: Where it comes from, for messages.
        greeting: What is expected of it.
        timeout_s: Seconds within which the engine has to prove itself.

    Attributes:
        socket: The same socket.
        name: As given.
        greeting: As given.
        received: What was received and is not part of the greeting yet.
        is_rejected: Whether it was rejected; it stays open for a moment so that it can read why.
    """

    def __init__(
        self, connection: socket.socket, name: str, greeting: Greeting, timeout_s: float
    ) -> None:
        connection.setblocking(False)
        self.socket = connection
        self.name = name
        self.greeting = greeting
        self.received = bytearray()
        self.is_rejected = False
        self._timeout_s = timeout_s
        self._deadline = time.monotonic() + timeout_s

    def read(self) -> bool:
        """Read what has arrived, and answer it; return False once the other side is gone.

        Raises:
            ProtocolError: Something else than a greeting came.
            GreetingRefused: There is no common version, or the proof is wrong.
        """
        try:
            data = self.socket.recv(READ_BYTES)
            if not self.is_rejected:
                self.received += data
                return bool(data) and self._answer()
        except (BlockingIOError, InterruptedError):
            return True
        except OSError:
            return False
        return bool(data)

    def _answer(self) -> bool:
        """Answer the whole frames that have come; return False if one of them ends it."""
        while not self.greeting.is_over and (frame := self._take_frame()) is not None:
            if frame[0] in _ENDINGS:
                return False
            answer = self.greeting.answer(*frame)
            # A few bytes, the first on this connection: they find room, or the engine is none.
            if answer is not None and self.socket.send(answer) < len(answer):
                return False
        return True

    def _take_frame(self) -> tuple[FrameType, bytes] | None:
        if len(self.received) < HEADER_BYTES:
            return None
        frame_type, num_bytes = decode_header(self.received[:HEADER_BYTES])
        self.greeting.state.allow(frame_type)
        end = HEADER_BYTES + num_bytes
        if len(self.received) < end:
            return None
        payload = bytes(self.received[HEADER_BYTES:end])
        del self.received[:end]
        self.greeting.state.receive(frame_type)
        return frame_type, payload

    def check_deadline(self) -> None:
        """Check that the engine has not taken too long.

        Raises:
            EngineTimeout: The deadline has passed.
        """
        if time.monotonic() > self._deadline:
            raise EngineTimeout(f"no complete greeting arrived within {self._timeout_s:g} s")

    def reject(self, error: LudusError, code: str = "") -> None:
        """Tell the other side why, as far as it listens; nothing more is read as a greeting."""
        report = error_report(error)
        if code:
            report["code"] = code
        self.is_rejected = True
        self._timeout_s = LINGER_S
        self._deadline = time.monotonic() + LINGER_S
        with contextlib.suppress(OSError):
            self.socket.send(encode_json(FrameType.ERROR, self.greeting.refusal(report)))
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
