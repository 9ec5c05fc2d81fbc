"""One HTTP/1.1 connection that stays open.

Python's own client takes about 65 µs per request, as much as the rest of a step of a small game;
this one takes about 15 µs, as it reads of an answer only what matters: status, length, product.
"""

from __future__ import annotations

import re
from typing import NamedTuple

from ludus.engine import num_cores
from ludus.errors import EngineCrashed, EngineStartError, EngineTimeout, ProtocolError
from ludus.legacy.conversation import Conversation, Patience
from ludus.legacy.launching import GameWatch
from ludus.link import ByteStream, connect_until, refuse_stranger

__all__ = ["HttpConversation", "HttpFraming", "Response"]

_MAX_HEAD_BYTES = 64 * 1024
_MAX_BODY_BYTES = 256 * 1024 * 1024
_SPIN_S = 200e-6
"""How long to poll for an answer before blocking; waking up takes longer than many a step."""

_STATUS = re.compile(rb"HTTP/1\.[01] ([1-5][0-9][0-9])(?: |\r\n)")
_LENGTH = re.compile(rb"\r\ncontent-length:[ \t]*([0-9]{1,12})[ \t]*\r\n", re.IGNORECASE)
_PRODUCT = re.compile(rb"\r\nserver:[ \t]*([^\r\n]*?)[ \t]*\r\n", re.IGNORECASE)
_CLOSE = re.compile(rb"\r\nconnection:[ \t]*close[ \t]*\r\n", re.IGNORECASE)
_END = b"\r\n\r\n"


class Response(NamedTuple):
    """An answer.

    Attributes:
        status: HTTP's status, such as 200.
        product: What the program calls itself; empty if it does not.
        body: The bytes behind the head.
    """

    status: int
    product: str
    body: bytes


class HttpFraming:
    """A :class:`~ludus.legacy.conversation.Framing` for answers with a ``content-length``.

    Attributes:
        is_over: Whether the last answer was the last one of its connection.
    """

    def __init__(self) -> None:
        self.is_over = False
        self._buffer = bytearray()
        self._head: bytes | None = None
        self._num_searched = 0
        self._end = 0

    @property
    def has_pending(self) -> bool:
        """Whether part of an answer has come."""
        return bool(self._buffer)

    def encode(self, payload: bytes) -> bytes:
        """Return a request as it is."""
        return payload

    def feed(self, data: bytes) -> bytes:
        """Take in bytes; nothing is answered."""
        self._buffer += data
        return b""

    def take(self) -> Response | None:
        """Return the next whole answer; raises ``ProtocolError`` if it is not such HTTP."""
        if self._head is None and not self._read_head():
            return None
        head, end = self._head, self._end
        if head is None or len(self._buffer) < end:
            return None
        body = bytes(self._buffer[len(head) : end])
        del self._buffer[:end]
        self._head, self._num_searched = None, 0
        self.is_over = _CLOSE.search(head) is not None
        status, product = _STATUS.match(head), _PRODUCT.search(head)
        assert status is not None, "_read_head has found it"
        return Response(int(status[1]), product[1].decode("latin-1") if product else "", body)

    def _read_head(self) -> bool:
        """Take note of the head of an answer; return whether it is whole."""
        found = self._buffer.find(_END, self._num_searched)
        if found < 0:
            if len(self._buffer) > _MAX_HEAD_BYTES:
                raise _not_http(bytes(self._buffer))
            self._num_searched = max(0, len(self._buffer) - len(_END))
            return False
        head = bytes(self._buffer[: found + len(_END)])
        length = _LENGTH.search(head)
        if _STATUS.match(head) is None or length is None or int(length[1]) > _MAX_BODY_BYTES:
            raise _not_http(head)
        self._head, self._end = head, len(head) + int(length[1])
        return True


class HttpConversation(Conversation[Response]):
    """Sends a request, and receives its answer.

    A connection that the program has closed between two requests is opened again.

    Args:
        address: Host and port of the program.
        start_timeout_s: How long to wait for a program that does not listen yet, seconds.
        timeout_s: How long an answer may take, seconds.

    Raises:
        EngineStartError: Nobody listens, or another user's program.
    """

    def __init__(self, address: tuple[str, int], start_timeout_s: float, timeout_s: float) -> None:
        self._address = address
        host, port = address
        self._host_line = f" HTTP/1.1\r\nhost: {host}:{port}\r\n".encode()
        self._http = HttpFraming()
        patience = Patience(
            timeout_s,
            silence_hint="step_timeout_s sets this time; a program made with bevy_rl answers a "
            "step only when it calls send_step_result",
            gone_hint="start the program again; what it printed says why it ended",
        )
        stream = self._connect(start_timeout_s)
        refuse_stranger(address)
        super().__init__(stream, self._http, GameWatch(None), patience)

    def request(self, verb: str, path: str, body: bytes = b"") -> bytes:
        """Return the bytes of a request."""
        line = f"{verb} {path}".encode() + self._host_line
        if verb == "GET":
            return line + b"\r\n"
        return line + f"content-length: {len(body)}\r\n\r\n".encode() + body

    @property
    def is_stale(self) -> bool:
        """Whether the next request needs a new connection."""
        is_in_use = self._stream is not None and self._stream.is_readable()
        return is_in_use or self._http.is_over or self._http.has_pending

    def _prepare(self, stream: ByteStream) -> ByteStream:
        """Return the stream, or a new one unless this one is open with nothing under way."""
        if not self.is_stale:
            return stream
        stream.close()
        try:
            self._stream = self._connect(0.0)
        except EngineStartError as error:
            text = f"{stream.peer} has ended: {error.message}"
            raise EngineCrashed(text, self._patience.gone_hint) from error
        self._framing = self._http = HttpFraming()
        return self._stream

    def _connect(self, timeout_s: float) -> ByteStream:
        host, port = self._address
        try:
            connection = connect_until(self._address, timeout_s, lambda: None)
        except EngineTimeout as error:
            raise EngineStartError(
                f"nobody listens at http://{host}:{port}: {error.message}",
                hint="start the program first; bevy_rl listens at http://127.0.0.1:7878",
            ) from error
        is_alone = num_cores() <= 1
        peer = f"the program at http://{host}:{port}"
        return ByteStream(connection, peer, 0.0 if is_alone else _SPIN_S)


def _not_http(head: bytes) -> ProtocolError:
    return ProtocolError(
        f"not an HTTP/1.1 answer with a content-length up to {_MAX_BODY_BYTES}: {head[:200]!r}",
        hint="is it a program made with bevy_rl that listens there?",
    )
