"""JSON objects out of a stream of bytes without frames: an object ends where its brace closes.

No input or output happens here.
"""

from __future__ import annotations

import re
from typing import Any, cast

from ludus.errors import ProtocolError
from ludus.wire.godot_json import parse_godot_json

__all__ = ["MAX_MESSAGE_BYTES", "JsonStream"]

MAX_MESSAGE_BYTES = 1 << 20
"""Bulk data travels in files; a message is small."""

_START_BYTES = 64
"""What is looked at to tell another protocol at once."""

_BLANK = b" \t\r\n"
_OUTSIDE = re.compile(rb'["{}]')
_INSIDE = re.compile(rb'["\\]')
_HINT = "something other than a godot-ai game may be speaking on this connection"


class JsonStream:
    """Cuts a stream of bytes, fed in pieces of any size, into JSON objects.

    Each byte is looked at once, however small the pieces are.

    Args:
        max_bytes: Longest message.
    """

    def __init__(self, max_bytes: int = MAX_MESSAGE_BYTES) -> None:
        self._max_bytes = max_bytes
        self._buffer = bytearray()
        self._position = 0
        self._depth = 0
        self._is_in_text = False

    @property
    def num_pending_bytes(self) -> int:
        """Bytes of an object that is not whole yet."""
        return len(self._buffer)

    def feed(self, data: bytes) -> None:
        """Take in ``data``; call :meth:`take` until nothing is left."""
        self._buffer += data

    def take(self) -> dict[str, Any] | None:
        """Return the next object, None if it is not whole yet.

        Raises:
            ProtocolError: Something else than a JSON object came, or one that is too long. The
                stream cannot be used any more.
        """
        end = self._find_end()
        if (len(self._buffer) if end is None else end) > self._max_bytes:
            raise ProtocolError(
                f"a message of more than {self._max_bytes} bytes came", "bulk data goes into files"
            )
        if end is None:
            return None
        message = _parse(bytes(self._buffer[:end]))
        del self._buffer[:end]
        self._position = 0
        return message

    def _find_end(self) -> int | None:
        """Return where the first object ends, None if it is not whole."""
        if self._position == 0 and not self._begin():
            return None
        buffer = self._buffer
        while found := (_INSIDE if self._is_in_text else _OUTSIDE).search(buffer, self._position):
            character, at = found[0], found.start()
            if character == b"\\" and at + 1 == len(buffer):
                self._position = at  # what it escapes has not come yet
                return None
            self._position = at + (2 if character == b"\\" else 1)
            self._take(character)
            if self._depth == 0:
                return self._position
        self._position = len(buffer)
        return None

    def _begin(self) -> bool:
        """Drop blanks before an object; return whether one begins."""
        blank = len(self._buffer) - len(self._buffer.lstrip(_BLANK))
        del self._buffer[:blank]
        if not self._buffer:
            return False
        inner = self._buffer[1:_START_BYTES].lstrip(_BLANK)
        if not self._buffer.startswith(b"{") or (inner and inner[:1] not in b'"}'):
            start = bytes(self._buffer[:16])
            raise ProtocolError(f"a message must be a JSON object, this came: {start!r}", _HINT)
        return bool(inner) or len(self._buffer) >= _START_BYTES

    def _take(self, character: bytes) -> None:
        """Note one character that opens or closes something."""
        if character == b'"':
            self._is_in_text = not self._is_in_text
        elif character != b"\\":
            self._depth += 1 if character == b"{" else -1


def _parse(data: bytes) -> dict[str, Any]:
    try:
        # It begins with a brace, so it is an object.
        return cast(dict[str, Any], parse_godot_json(data))
    except ValueError as error:
        raise ProtocolError(f"a message is not JSON: {error}", _HINT) from error
