"""One HTTP/1.1 connection that stays open.

Python's own client takes about 65 µs per request, as much as the rest of a step of a small game;
this one takes about 15 µs, as it reads of an answer only what matters: status, length, product.
"""

from __future__ import annotations

import os
import re
import socket
import time
from typing import NamedTuple

from ludus.engine import allowed_cores
from ludus.errors import EngineCrashed, EngineStartError, EngineTimeout, ProtocolError

__all__ = ["Connection", "Response"]

_MAX_HEAD_BYTES = 64 * 1024
_MAX_BODY_BYTES = 256 * 1024 * 1024
_CHUNK_BYTES = 64 * 1024
_RETRY_S = 0.05
_SPIN_S = 200e-6
"""How long to look for an answer before going to sleep; waking up takes longer than many a step."""

_STATUS = re.compile(rb"HTTP/1\.[01] ([1-5][0-9][0-9])(?: |\r\n)")
_LENGTH = re.compile(rb"\r\ncontent-length:[ \t]*([0-9]{1,12})[ \t]*\r\n", re.IGNORECASE)
_PRODUCT = re.compile(rb"\r\nserver:[ \t]*([^\r\n]*?)[ \t]*\r\n", re.IGNORECASE)
_CLOSE = re.compile(rb"\r\nconnection:[ \t]*close[ \t]*\r\n", re.IGNORECASE)
_END = b"\r\n\r\n"
_GONE_HINT = "start the program again; what it printed says why it ended"


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


class Connection:
    """Sends a request, and receives its answer.

    A connection that the program has closed between two requests is made anew.

    Args:
        host: Of the program.
        port: Of the program.
        start_timeout_s: How long to wait for a program that does not listen yet, seconds.
        timeout_s: How long an answer may take, seconds.

    Raises:
        EngineStartError: Nobody listens.
    """

    def __init__(self, host: str, port: int, start_timeout_s: float, timeout_s: float) -> None:
        self._place = (host, port)
        self._host_line = f" HTTP/1.1\r\nhost: {host}:{port}\r\n".encode()
        self._timeout_s = timeout_s
        self._buffer = bytearray()
        self._spin_s = _SPIN_S if _num_cores() > 1 else 0.0
        self._socket: socket.socket | None = self._connect(start_timeout_s)

    def send(self, request: bytes) -> None:
        """Send what :meth:`request` has made; :meth:`receive` is next.

        Raises:
            EngineCrashed: The program has gone.
            EngineTimeout: It does not read.
        """
        open_socket = self._open_socket()
        try:
            open_socket.sendall(request)
        except TimeoutError as error:
            raise self._late() from error
        except OSError as error:
            raise self._gone(error) from error

    def request(self, verb: str, path: str, body: bytes = b"") -> bytes:
        """Return the bytes of a request."""
        line = f"{verb} {path}".encode() + self._host_line
        if verb == "GET":
            return line + b"\r\n"
        return line + f"content-length: {len(body)}\r\n\r\n".encode() + body

    def receive(self) -> Response:
        """Wait for the next answer.

        Raises:
            EngineCrashed: The program has gone.
            EngineTimeout: The answer did not come in time.
            ProtocolError: It is no HTTP that this client knows.
        """
        deadline = time.monotonic() + self._timeout_s
        head_end = self._read_head(deadline)
        head = bytes(self._buffer[: head_end + len(_END)])
        status, length = _STATUS.match(head), _LENGTH.search(head)
        if status is None or length is None or int(length[1]) > _MAX_BODY_BYTES:
            raise self._not_http(head)
        end = len(head) + int(length[1])
        while len(self._buffer) < end:
            self._read(deadline)
        body = bytes(self._buffer[len(head) : end])
        del self._buffer[:end]
        if _CLOSE.search(head):
            self.close()
        product = _PRODUCT.search(head)
        return Response(int(status[1]), product[1].decode("latin-1") if product else "", body)

    def close(self) -> None:
        """Close the connection; may be called twice."""
        open_socket, self._socket = self._socket, None
        self._buffer.clear()
        if open_socket is not None:
            open_socket.close()

    def _connect(self, start_timeout_s: float) -> socket.socket:
        deadline = time.monotonic() + start_timeout_s
        while True:
            try:
                made = socket.create_connection(self._place, timeout=max(start_timeout_s, 0.001))
            except OSError as error:
                if time.monotonic() > deadline:
                    host, port = self._place
                    raise EngineStartError(
                        f"nobody listens at http://{host}:{port}: {error}",
                        hint="start the program first; bevy_rl listens at http://127.0.0.1:7878",
                    ) from error
                time.sleep(_RETRY_S)
            else:
                made.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                made.settimeout(self._timeout_s)
                return made

    def _open_socket(self) -> socket.socket:
        """Return a connection that the program has not closed."""
        if self._socket is not None and not self._buffer and self._is_open(self._socket):
            return self._socket
        self.close()
        try:
            self._socket = self._connect(0.0)
        except EngineStartError as error:
            raise EngineCrashed(f"the program has ended: {error.message}", _GONE_HINT) from error
        return self._socket

    def _is_open(self, idle: socket.socket) -> bool:
        """Return whether the other side keeps a connection on which nothing is under way."""
        idle.setblocking(False)
        try:
            # Neither an end nor an answer that nobody has asked for.
            idle.recv(1, socket.MSG_PEEK)
        except BlockingIOError:
            return True
        except OSError:
            return False
        else:
            return False
        finally:
            idle.settimeout(self._timeout_s)

    def _read_head(self, deadline: float) -> int:
        searched = 0
        while (end := self._buffer.find(_END, searched)) < 0:
            if len(self._buffer) > _MAX_HEAD_BYTES:
                raise self._not_http(bytes(self._buffer))
            searched = max(0, len(self._buffer) - len(_END))
            self._read(deadline)
        return end

    def _read(self, deadline: float) -> None:
        if self._socket is None:
            raise self._gone("the connection is closed")
        if time.monotonic() > deadline:
            raise self._late()
        try:
            received = self._spin(self._socket)
            if received is None:
                received = self._socket.recv(_CHUNK_BYTES)
        except TimeoutError as error:
            raise self._late() from error
        except OSError as error:
            raise self._gone(error) from error
        if not received:
            raise self._gone("it closed the connection")
        self._buffer += received

    def _spin(self, waiting: socket.socket) -> bytes | None:
        """Look for an answer without sleeping; return what came, or None if nothing did."""
        end = time.monotonic() + self._spin_s
        waiting.setblocking(False)
        try:
            while time.monotonic() < end:
                try:
                    return waiting.recv(_CHUNK_BYTES)
                except BlockingIOError:
                    pass
        finally:
            waiting.settimeout(self._timeout_s)
        return None

    def _gone(self, why: object) -> EngineCrashed:
        self.close()
        host, port = self._place
        return EngineCrashed(f"the program at http://{host}:{port} has gone: {why}", _GONE_HINT)

    def _late(self) -> EngineTimeout:
        self.close()
        host, port = self._place
        return EngineTimeout(
            f"the program at http://{host}:{port} did not answer within {self._timeout_s:g} s",
            hint="step_timeout_s sets this time; a program made with bevy_rl answers a step only "
            "when it calls send_step_result",
        )

    def _not_http(self, head: bytes) -> ProtocolError:
        self.close()
        return ProtocolError(
            f"no HTTP/1.1 answer with a content-length up to {_MAX_BODY_BYTES}: {head[:200]!r}",
            hint="is it a program made with bevy_rl that listens there?",
        )


def _num_cores() -> int:
    return len(allowed_cores() or ()) or os.cpu_count() or 1
