"""Whatever a game says, only documented errors come out, in bounded memory."""

from __future__ import annotations

import base64
import json
import socket
import time
import tracemalloc
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ludus.errors import ActionError, EngineTimeout, ProtocolError
from ludus.legacy.godot_gym_api.connection import Connection
from ludus.legacy.godot_gym_api.data import Data
from ludus.legacy.godot_gym_api.messages import decode_answer, encode_request
from ludus.link import LinkClosed
from tests.legacy.godot_gym_api.compiled import WALK

NUMBERS = st.integers() | st.floats()
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


@settings(max_examples=400, deadline=None)
@given(payload=PAYLOADS, module=MODULES)
def test_any_answer(payload: bytes, module: Any) -> None:
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


@settings(max_examples=200, deadline=None)
@given(request=st.dictionaries(st.text(max_size=8), JUNK, max_size=3))
def test_any_request(request: dict[str, Any]) -> None:
    try:
        payload = encode_request(request)
    except ActionError:
        return
    assert json.loads(payload) == {"observation": {}, **request}


def connected() -> tuple[Connection, socket.socket]:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        ours = socket.create_connection(listener.getsockname())
        return Connection(ours, 100), listener.accept()[0]


def receive(connection: Connection, timeout_s: float = 5.0) -> bytes:
    return connection.receive(time.monotonic() + timeout_s, lambda: None)


@settings(max_examples=80, deadline=None)
@given(data=st.binary(max_size=300))
def test_any_bytes(data: bytes) -> None:
    ours, theirs = connected()
    theirs.sendall(data)
    theirs.shutdown(socket.SHUT_WR)
    num_bytes = 0
    with pytest.raises((ProtocolError, LinkClosed)):
        while True:
            answer = receive(ours)
            assert len(answer) <= 100
            num_bytes += 4 + len(answer)
    assert num_bytes <= len(data)
    ours.close()
    theirs.close()


@settings(max_examples=50, deadline=None)
@given(answers=st.lists(st.binary(max_size=100), max_size=5), cut=st.integers(1, 9))
def test_answers_in_pieces(answers: list[bytes], cut: int) -> None:
    ours, theirs = connected()
    data = b"".join(len(answer).to_bytes(4, "little") + answer for answer in answers)
    for start in range(0, len(data), cut):
        theirs.sendall(data[start : start + cut])
    assert [receive(ours) for _ in answers] == answers
    with pytest.raises(EngineTimeout):
        receive(ours, 0.01)
    ours.close()
    theirs.close()


def test_a_length_alone_takes_no_memory() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        ours = Connection(socket.create_connection(listener.getsockname()), 1 << 30)
        theirs = listener.accept()[0]
    theirs.sendall((1 << 30).to_bytes(4, "little") + b"x")
    tracemalloc.start()
    with pytest.raises(EngineTimeout):
        receive(ours, 0.2)
    peak_bytes = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak_bytes < 1 << 23
    ours.close()
    theirs.close()
