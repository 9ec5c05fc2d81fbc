"""Frames received from a stream, their limits, and their JSON payloads (PROTOCOL.md §1)."""

from __future__ import annotations

import re
import struct
from itertools import pairwise
from pathlib import Path

import hypothesis.strategies as st
import pytest
from hypothesis import given, settings

from ludus.errors import ProtocolError
from ludus.link import LinkClosed
from ludus.wire.frames import (
    FrameType,
    decode_header,
    decode_json,
    encode_frame,
    encode_json,
    padded,
)
from tests.wire.golden import load_all
from tests.wire.strategies import json_objects
from tests.wire.stream import Frame, cut_frames, receive_frames

STREAM = b"".join(golden.frame for golden in load_all())
FRAMES = [Frame(golden.type, golden.payload) for golden in load_all()]
PROTOCOL = (Path(__file__).parents[2] / "protocol" / "PROTOCOL.md").read_text(encoding="utf-8")

JSON_BYTES = 16_777_216
BINARY_BYTES = 268_435_456
LIMITS = {
    FrameType.HELLO: 65_536,
    FrameType.WELCOME: JSON_BYTES,
    FrameType.SPEC: JSON_BYTES,
    FrameType.RESET: BINARY_BYTES,
    FrameType.STEP: BINARY_BYTES,
    FrameType.BATCH: BINARY_BYTES,
    FrameType.CALL: JSON_BYTES,
    FrameType.RESULT: JSON_BYTES,
    FrameType.PING: 1_048_576,
    FrameType.PONG: 1_048_576,
    FrameType.ERROR: JSON_BYTES,
    FrameType.CLOSE: 0,
    FrameType.CHALLENGE: 65_536,
    FrameType.PROOF: 65_536,
}


def header(num_bytes: int, number: int, flags: int = 0, reserved: int = 0) -> bytes:
    return struct.pack("<IBBH", num_bytes, number, flags, reserved)


def test_frames_that_arrive_byte_by_byte() -> None:
    assert receive_frames((STREAM[i : i + 1] for i in range(len(STREAM))), len(FRAMES)) == FRAMES


@given(st.lists(st.integers(0, len(STREAM)), max_size=20))
@settings(deadline=None)
def test_frames_that_arrive_in_any_pieces(cuts: list[int]) -> None:
    pieces = [STREAM[a:b] for a, b in pairwise([0, *sorted(cuts), len(STREAM)])]
    assert receive_frames(pieces, len(FRAMES)) == FRAMES


def test_a_truncated_frame_ends_the_connection() -> None:
    assert receive_frames([STREAM[:-3]], len(FRAMES) - 1) == FRAMES[:-1]
    with pytest.raises(LinkClosed):
        receive_frames([STREAM[:-3]], len(FRAMES))


def test_types_are_those_of_the_protocol() -> None:
    rows = re.findall(r"^\| (\d+) \| `([A-Z]+)` \| (?:engine|trainer|both) \|", PROTOCOL, re.M)
    assert {int(number): name for number, name in rows} == {t.value: t.name for t in FrameType}


@pytest.mark.parametrize("frame_type", FrameType)
def test_the_largest_payload_is_allowed(frame_type: FrameType) -> None:
    limit = LIMITS[frame_type]
    assert decode_header(header(limit, frame_type)) == (frame_type, limit)


@pytest.mark.parametrize("frame_type", FrameType)
def test_one_byte_more_is_refused(frame_type: FrameType) -> None:
    limit = LIMITS[frame_type]
    with pytest.raises(ProtocolError, match=f"{frame_type.name} .*{limit + 1}.* limit is {limit}"):
        decode_header(header(limit + 1, frame_type))


@pytest.mark.parametrize("limit", sorted(set(LIMITS.values()) - {0}))
def test_limits_are_those_of_the_protocol(limit: int) -> None:
    assert f"{limit:,} bytes" in PROTOCOL.replace("\n", " ")


@pytest.mark.parametrize("number", [0, 15, 71, 255])
def test_an_unknown_type_is_refused(number: int) -> None:
    with pytest.raises(ProtocolError, match=f"unknown type {number}"):
        decode_header(header(0, number))


@pytest.mark.parametrize(("flags", "reserved"), [(1, 0), (128, 0), (0, 1), (0, 65535)])
def test_flags_of_other_versions_are_refused(flags: int, reserved: int) -> None:
    with pytest.raises(ProtocolError, match=f"flags {flags}, reserved {reserved}"):
        decode_header(header(0, FrameType.CLOSE, flags, reserved))


@given(json_objects)
def test_json_round_trip(value: dict[str, object]) -> None:
    (frame,) = cut_frames(encode_json(FrameType.CALL, value))
    assert decode_json(frame.payload, "CALL") == value


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"{",
        b"[]",
        b"7",
        b"null",
        b'"text"',
        b"{} {}",
        b'{"a": NaN}',
        b'{"a": Infinity}',
        b"\xff\xfe{\x00}\x00",
        b'{"a": "\xff"}',
        b"[" * 100_000,
        b'{"a":' * 100_000,
        b'{"a": ' + b"9" * 5000 + b"}",
    ],
    ids=lambda payload: repr(payload[:12]),
)
def test_payloads_that_are_not_json_objects_are_refused(payload: bytes) -> None:
    with pytest.raises(ProtocolError, match=r"^SPEC "):
        decode_json(payload, "SPEC")


def test_nan_is_never_written() -> None:
    with pytest.raises(ValueError, match="JSON"):
        encode_json(FrameType.CALL, {"value": float("nan")})


@given(st.integers(0, 1 << 28))
def test_padding(num_bytes: int) -> None:
    assert padded(num_bytes) % 8 == 0
    assert 0 <= padded(num_bytes) - num_bytes < 8


@given(st.binary(max_size=64))
def test_frame_round_trip(payload: bytes) -> None:
    (frame,) = cut_frames(encode_frame(FrameType.PING, payload))
    assert frame == Frame(FrameType.PING, payload)
