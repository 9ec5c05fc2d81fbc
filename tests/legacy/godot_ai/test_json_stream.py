from __future__ import annotations

import contextlib
import json
import math
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ludus.errors import ProtocolError
from ludus.serve.godot_ai.json_stream import MAX_MESSAGE_BYTES, JsonStream
from ludus.wire.godot_json import parse_godot_json

VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
    max_leaves=12,
)
OBJECTS = st.dictionaries(st.text(), VALUES, max_size=5)
BLANKS = st.text(" \t\r\n", max_size=3).map(str.encode)
JSON_PARTS = [b"{", b"}", b'"', b"\\", b"[", b"]", b":", b",", b"1", b"nan", b"\xc3", b"\xa9", b" "]


def take_all(stream: JsonStream) -> list[dict[str, Any]]:
    messages: list[dict[str, Any]] = []
    while (message := stream.take()) is not None:
        messages.append(message)
    return messages


def outcome(pieces: list[bytes], **options: Any) -> tuple[list[dict[str, Any]], str]:
    """Return the messages of a stream, and the error that ended it, if one did."""
    stream, messages = JsonStream(**options), list[dict[str, Any]]()
    try:
        for piece in pieces:
            stream.feed(piece)
            while (message := stream.take()) is not None:
                messages.append(message)
    except ProtocolError as error:
        return messages, error.message.partition(":")[0]
    return messages, ""


def cut(data: bytes, places: list[int]) -> list[bytes]:
    ends = sorted({place % (len(data) + 1) for place in places} | {len(data)})
    return [data[start:end] for start, end in zip([0, *ends], ends, strict=False)]


@settings(deadline=None)
@given(st.lists(OBJECTS, max_size=4), st.lists(st.integers(0, 10**6)), st.data())
def test_any_objects_in_any_pieces(
    objects: list[dict[str, Any]], places: list[int], data: st.DataObject
) -> None:
    parts: list[bytes] = []
    for value in objects:
        ascii_only = data.draw(st.booleans())
        text = json.dumps(value, ensure_ascii=ascii_only, indent=data.draw(st.sampled_from((0, 2))))
        with contextlib.suppress(UnicodeEncodeError):  # lone surrogates have no UTF-8
            parts += [data.draw(BLANKS), text.encode()]
    wire = b"".join([*parts, data.draw(BLANKS)])
    messages = [json.loads(part) for part in parts if part.strip()]
    assert outcome(cut(wire, places)) == (messages, "")
    assert outcome([bytes([byte]) for byte in wire]) == (messages, "")


@settings(deadline=None)
@given(st.binary(max_size=200) | st.lists(st.sampled_from(JSON_PARTS)).map(b"".join),
       st.lists(st.integers(0, 10**6)))  # fmt: skip
def test_fuzz_ends_in_documented_errors_however_it_is_cut(data: bytes, places: list[int]) -> None:
    whole = outcome([data], max_bytes=64)
    assert outcome(cut(data, places), max_bytes=64) == whole
    assert outcome([bytes([byte]) for byte in data], max_bytes=64) == whole


def test_several_in_one_segment_and_the_rest_later() -> None:
    stream = JsonStream()
    stream.feed(b'{"a": 1}{"b": "}{"}\n{"c": ')
    assert take_all(stream) == [{"a": 1}, {"b": "}{"}]
    assert stream.num_pending_bytes == len(b'{"c": ')
    stream.feed(b'"\\"}"}')
    assert take_all(stream) == [{"c": '"}'}]
    assert stream.num_pending_bytes == 0


def test_messages_before_a_mistake_are_not_lost() -> None:
    stream = JsonStream()
    stream.feed(b'{"a": 1}GET / HTTP/1.1\r\n')
    assert stream.take() == {"a": 1}
    with pytest.raises(ProtocolError, match="GET"):
        stream.take()


@pytest.mark.parametrize(
    "data",
    [
        b"GET / HTTP/1.1\r\n",
        b"[1]",
        b"\x10\x00\x00\x00\x01\x00\x00\x00",
        b"{\x00\x00\x00\x01\x00\x00\x00",
        b"}",
        b"{'a': 1}",
        b'{"a": 1,}',
        b'{"\xff": 1}',
        b'{"a": ' + b"[" * 100_000 + b"]" * 100_000 + b"}",
    ],
)
def test_what_is_no_object_is_refused_at_once(data: bytes) -> None:
    assert outcome([data]) == ([], outcome([data])[1])
    assert outcome([data])[1].startswith("a message")


def test_memory_is_bounded() -> None:
    stream = JsonStream()
    with pytest.raises(ProtocolError, match="more than 1048576 bytes"):
        for _ in range(40):
            stream.feed(b'{"a": "' + b"x" * (MAX_MESSAGE_BYTES // 20))
            stream.take()
            assert stream.num_pending_bytes <= MAX_MESSAGE_BYTES


def test_the_longest_message_is_taken() -> None:
    text = b'{"a": "' + b"x" * (MAX_MESSAGE_BYTES - 9) + b'"}'
    assert len(text) == MAX_MESSAGE_BYTES
    assert outcome([text])[1] == ""
    assert outcome([text.replace(b"xx", b"xxx", 1)])[1].startswith("a message of more")


def test_numbers_and_texts_as_godot_writes_them() -> None:
    text = '{"a": [nan, -nan, inf, -inf, 1e99999, null, 5.0], "b": "\x01 nan, \\" inf", "info": 1}'
    values = parse_godot_json(text.encode())
    assert [math.isnan(value) for value in values["a"][:2]] == [True, True]
    assert values["a"][2:] == [math.inf, -math.inf, math.inf, None, 5.0]
    assert values["b"] == '\x01 nan, " inf'
    assert values["info"] == 1
