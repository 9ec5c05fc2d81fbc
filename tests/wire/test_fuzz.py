"""Bytes that no engine should send raise ``ProtocolError`` and nothing else."""

from __future__ import annotations

import contextlib
import json
import random
from typing import Any, cast

import hypothesis.strategies as st
import pytest
from hypothesis import given, settings

from ludus.errors import EngineStartError, ProtocolError
from ludus.wire.frames import FrameType, decode_json
from ludus.wire.handshake import Hello
from ludus.wire.spec_reader import read_spec
from ludus.wire.step import BatchDecoder
from tests.wire.golden import load_all
from tests.wire.strategies import json_values
from tests.wire.stream import Frame, cut_frames

GOLDEN = load_all()
DECODERS = [BatchDecoder(golden.spec) for golden in load_all(FrameType.BATCH)]
NUM_MUTATIONS = 150

# Values that arithmetic and conversions stumble over.
ODD_NUMBERS = [0, -1, 1.5, 2**31, 2**53, 2**64, 10**300, 10**4000, -0.0, 1e308, float("inf")]
ODD_VALUES: list[Any] = [*ODD_NUMBERS, None, True, "", "\ud800", "x" * 200, [], [[]], {}, [None]]


def read_any(frame: Frame) -> None:
    """Read a frame as the code does that receives its type."""
    match frame.type:
        case FrameType.HELLO:
            Hello.from_json(decode_json(frame.payload, "HELLO"))
        case FrameType.SPEC:
            BatchDecoder(read_spec(decode_json(frame.payload, "SPEC")))
        case FrameType.BATCH:
            for decoder in DECODERS:
                if len(frame.payload) <= len(decoder.buffer) - 8:
                    decoder.buffer[8 : 8 + len(frame.payload)] = frame.payload
                    decoder.decode(len(frame.payload))
        case FrameType.PING | FrameType.PONG | FrameType.CLOSE | FrameType.RESET | FrameType.STEP:
            pass
        case _:
            decode_json(frame.payload, frame.type.name)


def read_stream(data: bytes) -> None:
    with contextlib.suppress(ProtocolError):
        for frame in cut_frames(data):
            with contextlib.suppress(ProtocolError):
                read_any(frame)


@given(st.binary(max_size=512))
def test_random_bytes(data: bytes) -> None:
    read_stream(data)


@given(st.sampled_from(FrameType), st.binary(max_size=300))
def test_random_payloads(frame_type: FrameType, payload: bytes) -> None:
    with contextlib.suppress(ProtocolError):
        read_any(Frame(frame_type, payload))


@pytest.mark.parametrize("golden", GOLDEN, ids=lambda golden: golden.name)
def test_golden_frames_with_wrong_bytes(golden: Any) -> None:
    chance = random.Random(golden.name)
    for _ in range(NUM_MUTATIONS):
        frame = bytearray(golden.frame)
        for _ in range(chance.randint(1, 4)):
            frame[chance.randrange(len(frame))] = chance.choice([0, 1, 255, chance.randrange(256)])
        read_stream(bytes(frame))


@pytest.mark.parametrize("golden", GOLDEN, ids=lambda golden: golden.name)
def test_golden_frames_cut_and_spliced(golden: Any) -> None:
    chance = random.Random(golden.name)
    for _ in range(NUM_MUTATIONS):
        other = chance.choice(GOLDEN)
        head = golden.frame[: chance.randint(0, len(golden.frame))]
        tail = other.frame[chance.randint(0, len(other.frame)) :]
        read_stream(head + tail)


@pytest.mark.parametrize("golden", GOLDEN, ids=lambda golden: golden.name)
def test_every_prefix_of_a_payload(golden: Any) -> None:
    for size in range(len(golden.payload)):
        with contextlib.suppress(ProtocolError):
            read_any(Frame(golden.type, golden.payload[:size]))


def places(value: Any) -> list[list[Any]]:
    """Return the path of every value inside a JSON value."""
    inner: list[tuple[Any, Any]] = []
    if isinstance(value, dict):
        inner = list(cast(dict[str, Any], value).items())
    elif isinstance(value, list):
        inner = list(enumerate(cast(list[Any], value)))
    return [[], *([key, *path] for key, part in inner for path in places(part))]


def put(value: Any, path: list[Any], new: Any) -> Any:
    if not path:
        return new
    changed = value.copy()
    changed[path[0]] = put(value[path[0]], path[1:], new)
    return changed


def read_json(frame_type: FrameType, value: Any) -> None:
    text = json.dumps(value).replace("Infinity", "1e999")
    with contextlib.suppress(ProtocolError, EngineStartError):
        read_any(Frame(frame_type, text.encode()))
        if frame_type is FrameType.HELLO:
            hello = Hello.from_json(decode_json(text.encode(), "HELLO"))
            hello.agree()


@pytest.mark.parametrize(
    "golden", load_all(FrameType.HELLO, FrameType.SPEC), ids=lambda golden: golden.name
)
def test_an_odd_value_in_any_field_raises_only_documented_errors(golden: Any) -> None:
    for path in places(golden.content):
        for odd in ODD_VALUES:
            read_json(golden.type, put(golden.content, path, odd))


@given(st.data())
@settings(deadline=None)
def test_any_json_anywhere(data: st.DataObject) -> None:
    golden = data.draw(st.sampled_from(load_all(FrameType.HELLO, FrameType.SPEC)))
    path = data.draw(st.sampled_from(places(golden.content)))
    read_json(golden.type, put(golden.content, path, data.draw(json_values)))


def test_a_spec_that_needs_more_memory_than_a_frame_may_have_is_refused() -> None:
    golden = next(golden for golden in GOLDEN if golden.name == "spec_flat")
    huge = put(golden.content, ["policies", 0, "observation", 0, "shape"], [1 << 26])
    with pytest.raises(ProtocolError, match="268435456"):
        read_spec(huge)
