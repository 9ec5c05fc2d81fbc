"""One WebSocket connection with a game: whole texts, deadlines, no thread.

The library ``websockets`` speaks the protocol without input and output; the socket is ours. So a
step costs no switch of threads, and every wait can look after the game's process.
"""

from __future__ import annotations

import socket
import time
from collections import deque
from collections.abc import Callable

from websockets.exceptions import PayloadTooBig
from websockets.frames import Frame, Opcode
from websockets.http11 import Request
from websockets.protocol import SEND_EOF, State
from websockets.server import ServerProtocol

from ludus.errors import EngineTimeout, ProtocolError
from ludus.link import LinkClosed

__all__ = ["WebSocket"]

_READ_BYTES = 1 << 16
_POLL_S = 0.25


class WebSocket:
    """The server's end of one connection.

    Args:
        connection: Open socket; closed with this object.
        max_message_bytes: Longest message that is taken, in one piece or in fragments.
    """

    def __init__(self, connection: socket.socket, max_message_bytes: int) -> None:
        self._socket = connection
        # A page in a browser says its origin; a game has none.
        self._protocol = ServerProtocol(origins=[None], max_size=max_message_bytes)
        self._messages: deque[bytes] = deque()
        self._fragments = bytearray()
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    @property
    def has_message(self) -> bool:
        """Whether a message has come that nobody has taken."""
        return bool(self._messages)

    def shake_hands(self, deadline: float, check: Callable[[], None]) -> None:
        """Do the opening handshake; errors as :meth:`receive`."""
        while self._protocol.state is State.CONNECTING:
            self._read(deadline, check)
            if self._protocol.handshake_exc is not None:
                raise ProtocolError(f"no WebSocket handshake: {self._protocol.handshake_exc}")

    def send(self, text: str, timeout_s: float) -> None:
        """Send one message.

        Raises:
            LinkClosed: The other side has gone.
            EngineTimeout: It does not read.
        """
        if self._protocol.state is not State.OPEN:
            raise LinkClosed("the connection is closed")
        self._protocol.send_text(text.encode())
        self._flush(timeout_s)

    def receive(self, deadline: float, check: Callable[[], None]) -> bytes:
        """Return the next message.

        Args:
            deadline: On the clock of ``time.monotonic``, seconds.
            check: Called about four times a second; raises if waiting has become pointless.

        Raises:
            LinkClosed: The other side has gone.
            EngineTimeout: No whole message came in time.
            ProtocolError: Something came that is no WebSocket text, or a message too long.
        """
        while not self._messages:
            self._read(deadline, check)
        return self._messages.popleft()

    def drain(self, timeout_s: float) -> None:
        """Read until the other side has closed the connection, or for ``timeout_s`` seconds."""
        deadline = time.monotonic() + timeout_s
        try:
            while True:
                self._read(deadline, lambda: None)
                self._messages.clear()
        except (LinkClosed, EngineTimeout, ProtocolError):
            return

    def close(self) -> None:
        """Close the connection; may be called twice."""
        self._messages.clear()
        self._socket.close()

    def _read(self, deadline: float, check: Callable[[], None]) -> None:
        """Take in whatever comes next, and answer what the protocol answers by itself."""
        data = self._read_bytes(deadline, check)
        if data:
            self._protocol.receive_data(data)
        else:
            self._protocol.receive_eof()
        for event in self._protocol.events_received():
            if isinstance(event, Request):
                self._protocol.send_response(self._protocol.accept(event))
            elif isinstance(event, Frame):
                self._take(event)
        self._flush(_POLL_S)
        self._raise_if_over()

    def _read_bytes(self, deadline: float, check: Callable[[], None]) -> bytes:
        while (left_s := deadline - time.monotonic()) > 0.0:
            self._socket.settimeout(min(left_s, _POLL_S))
            try:
                return self._socket.recv(_READ_BYTES)
            except TimeoutError:
                check()
            except OSError as error:
                raise LinkClosed(str(error)) from error
        raise EngineTimeout("no answer came in time")

    def _take(self, frame: Frame) -> None:
        if frame.opcode is Opcode.BINARY:
            raise ProtocolError(
                "a binary message came, expected a text",
                hint="the game must set WebSocketPeer.WRITE_MODE_TEXT",
            )
        if frame.opcode not in {Opcode.TEXT, Opcode.CONT}:
            return
        self._fragments += frame.data
        if frame.fin:
            self._messages.append(bytes(self._fragments))
            self._fragments.clear()

    def _flush(self, timeout_s: float) -> None:
        pieces = self._protocol.data_to_send()
        if not pieces:
            return
        self._socket.settimeout(timeout_s)
        try:
            self._socket.sendall(b"".join(pieces))
            if SEND_EOF in pieces:
                self._socket.shutdown(socket.SHUT_WR)
        except TimeoutError as error:
            raise EngineTimeout(f"the game read nothing for {timeout_s:g} s") from error
        except OSError as error:
            raise LinkClosed(str(error)) from error

    def _raise_if_over(self) -> None:
        if self._messages or self._protocol.state in {State.CONNECTING, State.OPEN}:
            return
        reason = self._protocol.parser_exc
        if isinstance(reason, PayloadTooBig):
            raise ProtocolError(
                f"the game sent a message that is too long: {reason}",
                hint="does observation_space have the size of what get_observation() returns?",
            )
        if reason is not None and not isinstance(reason, EOFError):
            raise ProtocolError(f"the game broke the WebSocket protocol: {reason}")
        raise LinkClosed("the game closed the connection")
