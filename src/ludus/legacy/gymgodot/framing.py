"""The server's end of a WebSocket, without input and output: texts, in frames or fragments.

The library ``websockets`` speaks the protocol; the socket is ours. So a step costs no switch of
threads, and every wait can look after the game's process.
"""

from __future__ import annotations

from collections import deque

from websockets.exceptions import PayloadTooBig
from websockets.frames import Frame, Opcode
from websockets.http11 import Request
from websockets.protocol import State
from websockets.server import ServerProtocol

from ludus.errors import ProtocolError
from ludus.link import LinkClosed

__all__ = ["WebSocketFraming"]


class WebSocketFraming:
    """A :class:`~ludus.legacy.conversation.Framing`; the game speaks first, to shake hands.

    Args:
        max_message_bytes: Longest message that is taken, in one piece or in fragments.
    """

    def __init__(self, max_message_bytes: int) -> None:
        # A page in a browser says its origin; a game has none.
        self._protocol = ServerProtocol(origins=[None], max_size=max_message_bytes)
        self._messages: deque[bytes] = deque()
        self._fragments = bytearray()

    @property
    def is_connecting(self) -> bool:
        """Whether the opening handshake is not over.

        Raises:
            ProtocolError: It failed.
        """
        if self._protocol.handshake_exc is not None:
            raise ProtocolError(f"no WebSocket handshake: {self._protocol.handshake_exc}")
        return self._protocol.state is State.CONNECTING

    @property
    def has_pending(self) -> bool:
        """Whether a message has come that nobody has taken."""
        return bool(self._messages)

    def encode(self, payload: bytes) -> bytes:
        """Return a text frame; raises ``LinkClosed`` after the end of the conversation."""
        if self._protocol.state is not State.OPEN:
            raise LinkClosed("the connection is closed")
        self._protocol.send_text(payload)
        return b"".join(self._protocol.data_to_send())

    def feed(self, data: bytes) -> bytes:
        """Take in bytes; return what the protocol answers by itself.

        Raises:
            ProtocolError: A message is binary.
        """
        self._protocol.receive_data(data)
        for event in self._protocol.events_received():
            if isinstance(event, Request):
                self._protocol.send_response(self._protocol.accept(event))
            elif isinstance(event, Frame):
                self._take(event)
        return b"".join(self._protocol.data_to_send())

    def take(self) -> bytes | None:
        """Return the next text; errors as :meth:`Framing.take`."""
        if self._messages:
            return self._messages.popleft()
        if self._protocol.state in {State.CONNECTING, State.OPEN}:
            return None
        reason = self._protocol.parser_exc
        if isinstance(reason, PayloadTooBig):
            raise ProtocolError(
                f"the game sent a message that is too long: {reason}",
                hint="does observation_space have the size of what get_observation() returns?",
            )
        if reason is not None and not isinstance(reason, EOFError):
            raise ProtocolError(f"the game broke the WebSocket protocol: {reason}")
        raise LinkClosed("the game closed the connection")

    def _take(self, frame: Frame) -> None:
        if frame.opcode is Opcode.BINARY:
            raise ProtocolError(
                "a binary message came, expected a text",
                hint="the game must set WebSocketPeer.WRITE_MODE_TEXT",
            )
        if frame.opcode in {Opcode.TEXT, Opcode.CONT}:
            self._fragments += frame.data
            if frame.fin:
                self._messages.append(bytes(self._fragments))
                self._fragments.clear()
