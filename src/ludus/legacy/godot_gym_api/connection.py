"""One connection with a game: a length (u32, little-endian) and as many bytes, with deadlines."""

from __future__ import annotations

import select
import socket
import struct
import sys
import time
from collections.abc import Callable

from ludus.errors import EngineTimeout, ProtocolError
from ludus.link import LinkClosed

__all__ = ["Connection", "connect"]

_HEADER_BYTES = 4
_MIN_READ_BYTES = 1 << 12
_MAX_READ_BYTES = 1 << 20
_POLL_S = 0.25
_RETRY_S = 0.05
_WAITS_ITSELF = sys.platform != "win32"
"""Whether a socket may wait for a limited time: in Windows it is of no use afterwards."""


class Connection:
    """Whole requests out, whole answers in.

    A step costs three calls of the system: is there something that nobody asked for; send; receive,
    in which the system waits, for :data:`_POLL_S` at most.

    Args:
        connection: Open socket; closed with this object.
        max_answer_bytes: Longest answer that is taken.
    """

    def __init__(self, connection: socket.socket, max_answer_bytes: int) -> None:
        self._socket = connection
        self._max_answer_bytes = max_answer_bytes
        self._received = bytearray()
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._await_bytes = _waiter(connection)
        _limit_waits(connection)

    def send(self, payload: bytes, timeout_s: float) -> None:
        """Send one request.

        Raises:
            LinkClosed: The game has gone.
            EngineTimeout: It does not read.
        """
        frame = len(payload).to_bytes(_HEADER_BYTES, "little") + payload
        try:
            num_bytes = self._send_at_once(frame)
            if num_bytes < len(frame):
                self._send_patiently(frame[num_bytes:], timeout_s)
        except TimeoutError as error:
            raise EngineTimeout(f"the game read nothing for {timeout_s:g} s") from error
        except OSError as error:
            raise LinkClosed(str(error)) from error

    def receive(self, deadline: float, check: Callable[[], None]) -> bytes:
        """Return one answer.

        Args:
            deadline: On the clock of ``time.monotonic``, seconds.
            check: Called about four times a second; raises if waiting has become pointless.

        Raises:
            LinkClosed: The game has gone.
            EngineTimeout: No whole answer came in time.
            ProtocolError: The answer is too long.
        """
        received = self._received
        self._fill(_HEADER_BYTES, deadline, check)
        num_bytes = int.from_bytes(received[:_HEADER_BYTES], "little")
        if num_bytes > self._max_answer_bytes:
            raise ProtocolError(
                f"an answer of {num_bytes} bytes is announced, expected at most "
                f"{self._max_answer_bytes}",
                hint="is what answers there a game for godot_gym_api? If answers really are as "
                "long, raise max_answer_bytes",
            )
        end = _HEADER_BYTES + num_bytes
        self._fill(end, deadline, check)
        answer = bytes(received[_HEADER_BYTES:end])
        del received[:end]
        return answer

    def has_unread(self) -> bool:
        """Whether something has come that nobody asked for."""
        if self._received:
            return True
        try:
            return self._await_bytes(0.0) and bool(self._socket.recv(1, socket.MSG_PEEK))
        except OSError:
            return False

    def close(self) -> None:
        """Close the connection; may be called twice."""
        self._socket.close()

    def _send_at_once(self, frame: bytes) -> int:
        try:
            return self._socket.send(frame)
        except BlockingIOError:
            return 0

    def _send_patiently(self, rest: bytes, timeout_s: float) -> None:
        self._socket.settimeout(timeout_s)
        try:
            self._socket.sendall(rest)
        finally:
            _limit_waits(self._socket)

    def _fill(self, num_bytes: int, deadline: float, check: Callable[[], None]) -> None:
        while len(self._received) < num_bytes:
            self._read(num_bytes - len(self._received), deadline, check)

    def _read(self, missing_bytes: int, deadline: float, check: Callable[[], None]) -> None:
        left_s = deadline - time.monotonic()
        if left_s <= 0.0:
            raise EngineTimeout("no answer came in time")
        waits_itself = _WAITS_ITSELF and left_s >= _POLL_S
        if not waits_itself and not self._await_bytes(min(left_s, _POLL_S)):
            check()
            return
        try:
            data = self._socket.recv(min(max(missing_bytes, _MIN_READ_BYTES), _MAX_READ_BYTES))
        except BlockingIOError:
            check()
            return
        except OSError as error:
            raise LinkClosed(str(error)) from error
        if not data:
            raise LinkClosed("the game closed the connection")
        self._received += data


def _limit_waits(connection: socket.socket) -> None:
    """Let the socket wait for `_POLL_S` at most, or not at all; then it raises BlockingIOError."""
    connection.setblocking(_WAITS_ITSELF)
    if _WAITS_ITSELF:
        limit = struct.pack("@ll", 0, int(_POLL_S * 1e6))
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, limit)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, limit)


def _waiter(connection: socket.socket) -> Callable[[float], bool]:
    """Return what waits for bytes for so many seconds, and tells whether some have come."""
    if sys.platform == "win32":
        return lambda timeout_s: bool(select.select([connection], [], [], timeout_s)[0])
    poll = select.poll()  # `select` knows no more than 1024 files, `selectors` are slower
    poll.register(connection, select.POLLIN)
    return lambda timeout_s: bool(poll.poll(timeout_s * 1000.0))


def connect(
    address: tuple[str, int], timeout_s: float, max_answer_bytes: int, check: Callable[[], None]
) -> Connection:
    """Connect to a game, again and again until it listens.

    Args:
        address: Host and port.
        timeout_s: Longest wait, seconds.
        max_answer_bytes: Longest answer that is taken.
        check: Called before each try; raises if waiting has become pointless.

    Raises:
        EngineTimeout: Nothing listened there in time.
    """
    deadline = time.monotonic() + timeout_s
    reason = "no time to try"
    while (left_s := deadline - time.monotonic()) > 0.0:
        check()
        try:
            return Connection(socket.create_connection(address, left_s), max_answer_bytes)
        except OSError as error:
            reason = str(error)
            time.sleep(min(_RETRY_S, left_s))
    raise EngineTimeout(
        f"no game listened at {address[0]}:{address[1]} within {timeout_s:g} s ({reason})"
    )
