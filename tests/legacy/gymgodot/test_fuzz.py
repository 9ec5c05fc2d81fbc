"""Whatever a game says, only documented errors come out, in bounded memory."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from gymnasium import spaces
from hypothesis import given, settings
from hypothesis import strategies as st
from websockets.client import ClientProtocol
from websockets.frames import Frame, Opcode
from websockets.uri import parse_uri

from ludus.errors import ActionError, GameError, ProtocolError
from ludus.legacy.gymgodot.framing import WebSocketFraming
from ludus.legacy.gymgodot.messages import (
    read_render,
    read_reset,
    read_step,
    step_request,
)
from ludus.legacy.spaces import max_message_bytes, to_action_list, to_observation
from ludus.link import LinkClosed

NUMBERS = st.integers() | st.floats()
JUNK: st.SearchStrategy[Any] = st.recursive(
    st.none() | st.booleans() | NUMBERS | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=3), inner),
    max_leaves=12,
)
ANSWERS = st.fixed_dictionaries(
    {},
    optional={
        "observation": st.lists(NUMBERS, max_size=4) | JUNK,
        "init_observation": st.lists(NUMBERS, max_size=4) | JUNK,
        "reward": NUMBERS | JUNK,
        "done": st.booleans() | JUNK,
        "render_error": st.sampled_from(["0", "7", "-1", "²", "9" * 5000]) | JUNK,
    },
)
MESSAGES = st.binary(max_size=60) | (ANSWERS | JUNK).map(lambda value: json.dumps(value).encode())
SPACES = st.sampled_from(
    [
        spaces.Discrete(3),
        spaces.Discrete(3, start=-1),
        spaces.Box(-1.0, 1.0, (2,)),
        spaces.Box(0, 255, (1, 2), np.uint8),
        spaces.MultiDiscrete([2, 3]),
        spaces.MultiBinary(2),
    ]
)
READERS: list[Callable[[bytes], Any]] = [read_step, read_reset, read_render]


@pytest.mark.slow
@settings(max_examples=300, deadline=None)
@given(message=MESSAGES, reader=st.sampled_from(READERS))
def test_any_message_raises_documented_errors_only(
    message: bytes, reader: Callable[[bytes], Any]
) -> None:
    try:
        answer: Any = reader(message)
    except (ProtocolError, GameError) as error:
        assert len(str(error)) < 600
        return
    if reader is read_step:
        assert np.isfinite(answer.reward)
    if reader is read_render:
        assert 0 <= answer < 1_000_000


@pytest.mark.parametrize("text", ["[" * 100_000, '{"a":' * 100_000, "1" * 100_000])
@pytest.mark.parametrize("reader", READERS)
def test_deeply_nested_messages_are_refused(text: str, reader: Callable[[bytes], Any]) -> None:
    with pytest.raises(ProtocolError):
        reader(text.encode())


@pytest.mark.slow
@settings(max_examples=300, deadline=None)
@given(space=SPACES, value=st.lists(NUMBERS, min_size=1, max_size=2) | JUNK)
def test_any_observation_is_checked(space: spaces.Space[Any], value: Any) -> None:
    try:
        observation = to_observation(space, value, "observation")
    except GameError:
        return
    assert np.isfinite(observation).all()
    assert np.asarray(observation).dtype == space.dtype
    assert np.shape(observation) == space.shape


@settings(max_examples=200, deadline=None)
@given(space=SPACES, action=JUNK)
def test_any_action_is_checked(space: spaces.Space[Any], action: Any) -> None:
    try:
        numbers = to_action_list(space, action)
    except ActionError:
        return
    json.loads(step_request(numbers))


@pytest.mark.parametrize(
    "space", [spaces.Discrete(3), spaces.Box(-1, 1, (2, 2)), spaces.MultiDiscrete([2, 3])]
)
def test_samples_survive_a_round_trip(space: spaces.Space[Any]) -> None:
    space.seed(1)
    for _ in range(5):
        sample = space.sample()
        sent = json.loads(step_request(to_action_list(space, sample)))["action"]
        assert np.array_equal(to_observation(space, sent, "observation"), sample)


def connected(max_bytes: int) -> tuple[WebSocketFraming, ClientProtocol]:
    """Return our end of a conversation, and the library's client at the other end."""
    framing = WebSocketFraming(max_bytes)
    client = ClientProtocol(parse_uri("ws://127.0.0.1:1/"))
    client.send_request(client.connect())
    client.receive_data(framing.feed(sent_by(client)))
    assert not framing.is_connecting
    return framing, client


def sent_by(client: ClientProtocol) -> bytes:
    return b"".join(client.data_to_send())


def take_all(framing: WebSocketFraming) -> list[bytes]:
    messages: list[bytes] = []
    try:
        while (message := framing.take()) is not None:
            messages.append(message)
    except (ProtocolError, LinkClosed):
        pass
    return messages


@settings(max_examples=100, deadline=None)
@given(data=st.binary(max_size=300))
def test_any_bytes_after_the_handshake_are_survived(data: bytes) -> None:
    framing, _ = connected(100)
    try:
        framing.feed(data)
    except ProtocolError:
        return
    assert all(len(message) <= 100 for message in take_all(framing))


@settings(max_examples=100, deadline=None)
@given(data=st.binary(max_size=300))
def test_any_bytes_instead_of_a_handshake_are_refused(data: bytes) -> None:
    framing = WebSocketFraming(100)
    framing.feed(data)
    try:
        assert framing.is_connecting
    except ProtocolError as error:
        assert "no WebSocket handshake" in str(error)


@pytest.mark.parametrize("num_fragments", [1, 2, 30])
@pytest.mark.parametrize(("num_bytes", "is_taken"), [(60, True), (100, True), (101, False)])
def test_message_limit_counts_all_fragments(
    num_fragments: int, num_bytes: int, *, is_taken: bool
) -> None:
    framing, client = connected(100)
    pieces = np.array_split(np.frombuffer(b"x" * num_bytes, np.uint8), num_fragments)
    for number, piece in enumerate(pieces):
        send = client.send_continuation if number else client.send_text
        send(piece.tobytes(), fin=number == num_fragments - 1)
    framing.feed(sent_by(client))
    assert take_all(framing) == ([b"x" * num_bytes] if is_taken else [])


def test_messages_are_read_byte_by_byte() -> None:
    framing, client = connected(100)
    client.send_text(b'{"init_observation": [1]}')
    for byte in sent_by(client):
        assert framing.take() is None
        framing.feed(bytes([byte]))
    assert [read_reset(message) for message in take_all(framing)] == [[1]]


def test_pings_are_answered_and_are_no_messages() -> None:
    framing, client = connected(100)
    client.send_ping(b"there?")
    client.receive_data(framing.feed(sent_by(client)))
    pong = client.events_received()[-1]
    assert isinstance(pong, Frame) and pong.opcode is Opcode.PONG
    assert not framing.has_pending


def test_closing_ends_the_conversation() -> None:
    framing, client = connected(100)
    client.send_close(1000)
    framing.feed(sent_by(client))
    with pytest.raises(LinkClosed, match="the game closed the connection"):
        framing.take()
    with pytest.raises(LinkClosed):
        framing.encode(b"{}")


def test_a_message_is_as_long_as_the_space_needs() -> None:
    space = spaces.Box(-np.inf, np.inf, (100, 100))
    numbers = np.full((100, 100), -1.2345678901234567e-300).tolist()
    assert len(json.dumps({"observation": numbers})) < max_message_bytes(space) < 1 << 20
