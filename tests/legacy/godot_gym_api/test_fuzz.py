"""Whatever a game says, only documented errors come out, in bounded memory."""

from __future__ import annotations

import base64
import json
import tracemalloc
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from ludus.errors import ActionError, ProtocolError
from ludus.legacy.godot_gym_api.data import Data
from ludus.legacy.godot_gym_api.messages import decode_answer, encode_request
from ludus.legacy.length_framing import LengthFraming
from tests.legacy.godot_gym_api.compiled import WALK

NUMBERS = st.integers(-(1 << 63), (1 << 63) - 1) | st.floats()
JUNK: st.SearchStrategy[Any] = st.recursive(
    st.none() | st.booleans() | NUMBERS | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(st.text(max_size=3) | st.just("$bytes"), inner, max_size=3)
    ),
    max_leaves=12,
)
ANSWERS = st.fixed_dictionaries(
    {}, optional={"agent_data": JUNK, "world_data": JUNK, "other": JUNK}
)
PAYLOADS = st.binary(max_size=60) | (ANSWERS | JUNK).map(lambda value: json.dumps(value).encode())
MODULES = st.sampled_from([None, WALK])


@pytest.mark.slow
@settings(max_examples=400, deadline=None)
@given(payload=PAYLOADS, module=MODULES)
@example(payload=b'{"$bytes":""}', module=None)  # an object in JSON, bytes in Godot's
def test_any_answer_raises_documented_errors_only(payload: bytes, module: Any) -> None:
    try:
        state = decode_answer(payload, module)
    except ProtocolError as error:
        assert len(str(error)) < 800
        return
    assert set(state) == {"agent", "world"}
    if payload[:1] == b"{" or module is None:
        assert all(isinstance(part, Data) for part in state.values())


@settings(max_examples=200, deadline=None)
@given(
    place=st.floats(width=32, allow_nan=False), frames=st.lists(st.integers(-(2**31), 2**31 - 1))
)
def test_protobuf_answers_are_read(place: float, frames: list[int]) -> None:
    message = WALK.Message(agent_data={"place": place, "frames": frames})
    state = decode_answer(message.SerializeToString(), WALK)
    assert (state["agent"].place, list(state["agent"].frames)) == (place, frames)
    assert not state["world"].is_far


@settings(max_examples=200, deadline=None)
@given(data=st.binary(max_size=40), fields=st.dictionaries(st.text(max_size=4), NUMBERS))
def test_json_answers_are_read(data: bytes, fields: dict[str, float]) -> None:
    picture = {"$bytes": base64.b64encode(data).decode()}
    payload = json.dumps({"agent_data": {"picture": picture}, "world_data": fields}).encode()
    state = decode_answer(payload)
    assert state["agent"].picture == data
    assert repr(dict(state["world"])) == repr(fields)


@pytest.mark.slow
@settings(max_examples=200, deadline=None)
@given(request=st.dictionaries(st.text(max_size=8), JUNK, max_size=3))
def test_any_request_is_json_or_refused(request: dict[str, Any]) -> None:
    try:
        payload = encode_request(request)
    except ActionError:
        return
    assert json.loads(payload) == {"observation": {}, **request}


def take_all(framing: LengthFraming) -> list[bytes]:
    answers: list[bytes] = []
    while (answer := framing.take()) is not None:
        answers.append(answer)
    return answers


@settings(max_examples=200, deadline=None)
@given(data=st.binary(max_size=300))
def test_any_bytes_are_cut_within_the_limit(data: bytes) -> None:
    framing = LengthFraming(100)
    framing.feed(data)
    try:
        answers = take_all(framing)
    except ProtocolError:
        return
    assert all(len(answer) <= 100 for answer in answers)
    assert sum(4 + len(answer) for answer in answers) <= len(data)


@settings(max_examples=100, deadline=None)
@given(answers=st.lists(st.binary(max_size=100), max_size=5), cut=st.integers(1, 9))
def test_answers_in_pieces(answers: list[bytes], cut: int) -> None:
    framing = LengthFraming(100)
    data = b"".join(framing.encode(answer) for answer in answers)
    taken: list[bytes] = []
    for start in range(0, len(data), cut):
        assert framing.feed(data[start : start + cut]) == b""
        taken += take_all(framing)
    assert taken == answers
    assert not framing.has_pending


def test_a_length_alone_takes_no_memory() -> None:
    framing = LengthFraming(1 << 30)
    tracemalloc.start()
    framing.feed((1 << 30).to_bytes(4, "little") + b"x")
    assert framing.take() is None
    peak_bytes = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak_bytes < 1 << 20
