"""Frames: header, types, limits, JSON payloads (PROTOCOL.md §1). No input or output."""

from __future__ import annotations

import json
import struct
from enum import IntEnum
from typing import Any, cast

from ludus.errors import ProtocolError

__all__ = [
    "HEADER",
    "HEADER_BYTES",
    "FrameType",
    "decode_header",
    "decode_json",
    "encode_frame",
    "encode_json",
    "padded",
    "parse_json",
]

HEADER = struct.Struct("<IBBH")
HEADER_BYTES = HEADER.size
MAX_BINARY_BYTES = 1 << 28
MAX_JSON_BYTES = 1 << 24
MAX_PING_BYTES = 1 << 20
MAX_GREETING_BYTES = 1 << 16
"""Of frames that somebody sends who has proved nothing yet."""
MAX_WORLDS = 65_536


class FrameType(IntEnum):
    """What a frame carries."""

    HELLO = 1
    WELCOME = 2
    SPEC = 3
    RESET = 4
    STEP = 5
    BATCH = 6
    CALL = 7
    RESULT = 8
    PING = 9
    PONG = 10
    ERROR = 11
    CLOSE = 12
    CHALLENGE = 13
    PROOF = 14


_TYPES = {int(frame_type): frame_type for frame_type in FrameType}
_LIMITS = {
    FrameType.HELLO: MAX_GREETING_BYTES,
    FrameType.CHALLENGE: MAX_GREETING_BYTES,
    FrameType.PROOF: MAX_GREETING_BYTES,
    FrameType.RESET: MAX_BINARY_BYTES,
    FrameType.STEP: MAX_BINARY_BYTES,
    FrameType.BATCH: MAX_BINARY_BYTES,
    FrameType.PING: MAX_PING_BYTES,
    FrameType.PONG: MAX_PING_BYTES,
    FrameType.CLOSE: 0,
}


def padded(num_bytes: int) -> int:
    """Return ``num_bytes`` rounded up to a multiple of 8."""
    return (num_bytes + 7) & ~7


def decode_header(header: bytes | bytearray | memoryview) -> tuple[FrameType, int]:
    """Return type and payload length of the 8-byte header that ``header`` begins with.

    Raises:
        ProtocolError: Unknown type, set reserved bits, or a length over the limit.
    """
    num_bytes, number, flags, reserved = HEADER.unpack_from(header)
    frame_type = _TYPES.get(number)
    if frame_type is None:
        raise ProtocolError(
            f"frame of unknown type {number}",
            hint="the other side of the connection may not be a Ludus engine",
        )
    if flags or reserved:
        raise ProtocolError(f"{frame_type.name} frame with flags {flags}, reserved {reserved}")
    limit = _LIMITS.get(frame_type, MAX_JSON_BYTES)
    if num_bytes > limit:
        raise ProtocolError(f"{frame_type.name} frame of {num_bytes} bytes, the limit is {limit}")
    return frame_type, num_bytes


def encode_frame(frame_type: FrameType, payload: bytes | bytearray | memoryview = b"") -> bytes:
    """Return header and payload as one piece."""
    return HEADER.pack(len(payload), frame_type, 0, 0) + bytes(payload)


def encode_json(frame_type: FrameType, value: dict[str, Any]) -> bytes:
    """Return a whole frame with a JSON payload."""
    text = json.dumps(value, separators=(",", ":"), allow_nan=False)
    return encode_frame(frame_type, text.encode())


def decode_json(payload: bytes | bytearray | memoryview, what: str) -> dict[str, Any]:
    """Return the JSON object of a payload.

    Raises:
        ProtocolError: It is not UTF-8, not JSON or not an object. ``what`` names the frame.
    """
    try:
        value = parse_json(payload)
    except ValueError as error:
        raise ProtocolError(f"{what} is not valid JSON: {error}") from error
    if not isinstance(value, dict):
        raise ProtocolError(f"{what} must be a JSON object, got {type(value).__name__}")
    return cast(dict[str, Any], value)


def parse_json(text: bytes | bytearray | memoryview) -> Any:
    """Return a JSON value; raise ``ValueError`` if the text is not UTF-8 or not JSON."""
    try:
        return json.loads(bytes(text).decode("utf-8"), parse_constant=_refuse_constant)
    except RecursionError as error:
        raise ValueError("nested too deeply") from error


def _refuse_constant(name: str) -> None:
    raise ValueError(f"{name} is not JSON")
