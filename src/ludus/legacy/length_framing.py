"""Messages with their length in front, without input or output."""

from __future__ import annotations

from ludus.errors import ProtocolError

__all__ = ["LengthFraming"]

_HEADER_BYTES = 4


class LengthFraming:
    """A :class:`~ludus.legacy.conversation.Framing`: a length (u32, little-endian), then the bytes.

    Args:
        max_answer_bytes: Longest answer that is taken.
        too_long_hint: Hint of the error about a longer one.
    """

    def __init__(self, max_answer_bytes: int, too_long_hint: str = "") -> None:
        self._max_answer_bytes = max_answer_bytes
        self._too_long_hint = too_long_hint
        self._received = bytearray()

    @property
    def has_pending(self) -> bool:
        """Whether part of an answer has come."""
        return bool(self._received)

    def encode(self, payload: bytes) -> bytes:
        """Return one request with its length."""
        return len(payload).to_bytes(_HEADER_BYTES, "little") + payload

    def feed(self, data: bytes) -> bytes:
        """Take in bytes; the wire itself answers nothing."""
        self._received += data
        return b""

    def take(self) -> bytes | None:
        """Return the next whole answer; raises ``ProtocolError`` if it is too long."""
        received = self._received
        if len(received) < _HEADER_BYTES:
            return None
        num_bytes = int.from_bytes(received[:_HEADER_BYTES], "little")
        if num_bytes > self._max_answer_bytes:
            raise ProtocolError(
                f"an answer of {num_bytes} bytes is announced, expected at most "
                f"{self._max_answer_bytes}",
                hint=self._too_long_hint,
            )
        end = _HEADER_BYTES + num_bytes
        if len(received) < end:
            return None
        answer = bytes(received[_HEADER_BYTES:end])
        del received[:end]
        return answer
