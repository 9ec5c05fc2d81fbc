"""Whatever a game says, only documented errors come out, in bounded memory."""

from __future__ import annotations

import json
import socket
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from gymnasium import spaces
from hypothesis import given, settings
from hypothesis import strategies as st
from websockets.client import ClientProtocol
from websockets.uri import parse_uri

from ludus.errors import ActionError, EngineTimeout, GameError, ProtocolError
from ludus.legacy.gymgodot.messages import (
    read_render,
    read_reset,
    read_step,
    step_request,
)
from ludus.legacy.gymgodot.spaces import max_message_bytes, to_action_list, to_observation
from ludus.legacy.gymgodot.web_socket import WebSocket
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


@settings(max_examples=300, deadline=None)
@given(message=MESSAGES, reader=st.sampled_from(READERS))
def test_any_message(message: bytes, reader: Callable[[bytes], Any]) -> None:
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
def test_deep_and_long_messages(text: str, reader: Callable[[bytes], Any]) -> None:
    with pytest.raises(ProtocolError):
        reader(text.encode())


@settings(max_examples=300, deadline=None)
@given(space=SPACES, value=st.lists(NUMBERS, min_size=1, max_size=2) | JUNK)
def test_any_observation(space: spaces.Space[Any], value: Any) -> None:
    try:
        observation = to_observation(space, value, "observation")
    except GameError:
        return
    assert np.isfinite(observation).all()
    assert np.asarray(observation).dtype == space.dtype
    assert np.shape(observation) == space.shape


@settings(max_examples=200, deadline=None)
@given(space=SPACES, action=JUNK)
def test_any_action(space: spaces.Space[Any], action: Any) -> None:
    try:
        numbers = to_action_list(space, action)
    except ActionError:
        return
    json.loads(step_request(numbers))


@pytest.mark.parametrize(
    "space", [spaces.Discrete(3), spaces.Box(-1, 1, (2, 2)), spaces.MultiDiscrete([2, 3])]
)
def test_samples_go_there_and_back(space: spaces.Space[Any]) -> None:
    space.seed(1)
    for _ in range(5):
        sample = space.sample()
        sent = json.loads(step_request(to_action_list(space, sample)))["action"]
        assert np.array_equal(to_observation(space, sent, "observation"), sample)


def connected(max_bytes: int) -> tuple[WebSocket, ClientProtocol, socket.socket]:
    """Return our end of a connection, and the library's client at the other end."""
    ours, theirs = _tcp_pair()
    client = ClientProtocol(parse_uri("ws://127.0.0.1:1/"))
    client.send_request(client.connect())
    theirs.sendall(b"".join(client.data_to_send()))
    link = WebSocket(ours, max_bytes)
    link.shake_hands(time.monotonic() + 5.0, lambda: None)
    client.receive_data(theirs.recv(4096))
    return link, client, theirs


def _tcp_pair() -> tuple[socket.socket, socket.socket]:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        theirs = socket.create_connection(listener.getsockname())
        return listener.accept()[0], theirs


def receive_all(link: WebSocket) -> list[bytes]:
    messages: list[bytes] = []
    try:
        while True:
            messages.append(link.receive(time.monotonic() + 5.0, lambda: None))
    except (ProtocolError, LinkClosed):
        return messages


@settings(max_examples=60, deadline=None)
@given(data=st.binary(max_size=300))
def test_any_bytes_after_the_handshake(data: bytes) -> None:
    link, _, theirs = connected(100)
    theirs.sendall(data)
    theirs.shutdown(socket.SHUT_WR)
    assert all(len(message) <= 100 for message in receive_all(link))
    link.close()
    theirs.close()


@settings(max_examples=60, deadline=None)
@given(data=st.binary(max_size=300))
def test_any_bytes_instead_of_a_handshake(data: bytes) -> None:
    ours, theirs = _tcp_pair()
    link = WebSocket(ours, 100)
    theirs.sendall(data)
    theirs.shutdown(socket.SHUT_WR)
    with pytest.raises((ProtocolError, LinkClosed)):
        link.shake_hands(time.monotonic() + 5.0, lambda: None)
    link.close()
    theirs.close()


@pytest.mark.parametrize("num_fragments", [1, 2, 30])
@pytest.mark.parametrize(("num_bytes", "is_taken"), [(60, True), (100, True), (101, False)])
def test_the_longest_message(num_fragments: int, num_bytes: int, *, is_taken: bool) -> None:
    link, client, theirs = connected(100)
    pieces = np.array_split(np.frombuffer(b"x" * num_bytes, np.uint8), num_fragments)
    for number, piece in enumerate(pieces):
        send = client.send_continuation if number else client.send_text
        send(piece.tobytes(), fin=number == num_fragments - 1)
    theirs.sendall(b"".join(client.data_to_send()))
    theirs.shutdown(socket.SHUT_WR)
    assert receive_all(link) == ([b"x" * num_bytes] if is_taken else [])
    link.close()
    theirs.close()


def test_a_byte_at_a_time() -> None:
    link, client, theirs = connected(100)
    client.send_text(b'{"init_observation": [1]}')
    theirs.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    for byte in b"".join(client.data_to_send()):
        theirs.sendall(bytes([byte]))
        time.sleep(0.001)
    message = link.receive(time.monotonic() + 5.0, lambda: None)
    assert read_reset(message) == [1]
    link.close()
    theirs.close()


def test_a_deadline_for_a_whole_message() -> None:
    link, client, theirs = connected(100)
    client.send_text(b"{", fin=False)
    theirs.sendall(b"".join(client.data_to_send()))
    with pytest.raises(EngineTimeout):
        link.receive(time.monotonic() + 0.2, lambda: None)
    link.close()
    theirs.close()


def test_a_message_is_as_long_as_the_space_needs() -> None:
    space = spaces.Box(-np.inf, np.inf, (100, 100))
    numbers = np.full((100, 100), -1.2345678901234567e-300).tolist()
    assert len(json.dumps({"observation": numbers})) < max_message_bytes(space) < 1 << 20
