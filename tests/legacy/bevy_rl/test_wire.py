"""The HTTP of the bevy_rl bridge, against servers that say anything at all."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Generator
from contextlib import contextmanager

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ludus.errors import EngineCrashed, EngineTimeout, GameError, LudusError, ProtocolError
from ludus.legacy.bevy_rl.game import Client
from ludus.legacy.bevy_rl.http import HttpConversation, HttpFraming, Response

_DEADLINE_S = 10.0
_FUZZ = settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


@contextmanager
def _server(
    *answers: bytes, stays: bool = False, timeout_s: float = _DEADLINE_S
) -> Generator[HttpConversation]:
    """Yield a conversation with a server that sends bytes for each request."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        listener.settimeout(_DEADLINE_S)
        is_over = threading.Event()

        def serve() -> None:
            accepted, _ = listener.accept()
            with accepted:
                accepted.settimeout(_DEADLINE_S)
                try:
                    for answer in answers:
                        accepted.recv(65536)
                        accepted.sendall(answer)
                except OSError:
                    return
                if stays:
                    is_over.wait(_DEADLINE_S)

        thread = threading.Thread(target=serve)
        thread.start()
        conversation = HttpConversation(listener.getsockname(), _DEADLINE_S, timeout_s)
        try:
            yield conversation
        finally:
            conversation.close()
            is_over.set()
            thread.join(_DEADLINE_S)
            assert not thread.is_alive()


def _ask(conversation: HttpConversation) -> Response:
    return conversation.ask(conversation.request("GET", "/state"), _itself)


def _itself(response: Response) -> Response:
    return response


@given(
    body=st.binary(max_size=300),
    status=st.integers(100, 599),
    piece=st.integers(1, 40),
    product=st.text("abc/0.", max_size=10),
)
@_FUZZ
def test_answers_are_read_however_they_are_cut(
    body: bytes, status: int, piece: int, product: str
) -> None:
    head = f"HTTP/1.1 {status} Text\r\nServer: {product}\r\nCONTENT-LENGTH:  {len(body)}\r\n\r\n"
    framing, answers = HttpFraming(), list[Response]()
    data = (head.encode() + body) * 2
    for start in range(0, len(data), piece):
        framing.feed(data[start : start + piece])
        while (answer := framing.take()) is not None:
            answers.append(answer)
    assert answers == [Response(status, product, body)] * 2
    assert not framing.has_pending


@given(answer=st.binary(max_size=200), is_begun=st.booleans())
@_FUZZ
def test_only_documented_errors_come_of_anything_else(answer: bytes, is_begun: bool) -> None:
    begin = b"HTTP/1.1 200 OK\r\ncontent-length: 5\r\n" if is_begun else b""
    with _server(begin + answer) as server:
        try:
            Client(server, with_pixels=False)
        except LudusError as error:
            assert isinstance(error, EngineCrashed | EngineTimeout | ProtocolError | GameError)


@pytest.mark.parametrize(
    "answer",
    [
        b"220 mail.example ESMTP\r\n\r\n",
        b"HTTP/1.1 200 OK\r\n\r\n[]",
        b"HTTP/1.1 200 OK\r\ntransfer-encoding: chunked\r\n\r\n0\r\n\r\n",
        b"HTTP/1.1 200 OK\r\ncontent-length: -1\r\n\r\n",
        b"HTTP/1.1 200 OK\r\ncontent-length: 99999999999\r\n\r\n",
        b"x" * 100_000,
    ],
)
def test_other_http_is_refused(answer: bytes) -> None:
    with (
        _server(answer, stays=True) as server,
        pytest.raises(ProtocolError, match="not an HTTP"),
    ):
        _ask(server)


def test_an_answer_that_stops_is_reported() -> None:
    answer = b"HTTP/1.1 200 OK\r\ncontent-length: 9\r\n\r\n[1"
    with (
        _server(answer) as server,
        pytest.raises(EngineCrashed, match="closed the connection"),
    ):
        _ask(server)
    with (
        _server(answer, stays=True, timeout_s=0.5) as server,
        pytest.raises(EngineTimeout, match=r"0\.5 s"),
    ):
        _ask(server)


def test_reasons_that_come_as_text_are_told() -> None:
    answer = b"HTTP/1.1 200 OK\r\ncontent-length: 25\r\n\r\nInvalid number of actions"
    with (
        _server(answer) as server,
        pytest.raises(GameError, match="Invalid number of actions"),
    ):
        Client(server, with_pixels=False)


@pytest.mark.parametrize(
    "body", [b"{}", b"[]", b"3", b'[{"reward":1}]', b'[{"reward":"x","is_terminated":0}]']
)
def test_agents_of_another_form_are_refused(body: bytes) -> None:
    state = b"HTTP/1.1 200 OK\r\ncontent-length: 2\r\n\r\n{}"
    agents = b"HTTP/1.1 200 OK\r\ncontent-length: %d\r\n\r\n%b" % (len(body), body)
    with _server(state, agents, stays=True) as server:
        client = Client(server, with_pixels=False)
        with pytest.raises(ProtocolError, match="expected a list"):
            client.reset()


@pytest.mark.parametrize("head", [b"", b"connection: close\r\n"], ids=["silently", "announced"])
def test_connection_closed_between_requests_is_reopened(head: bytes) -> None:
    answer = b"HTTP/1.1 200 OK\r\n" + head + b"content-length: 2\r\n\r\n{}"
    with socket.create_server(("127.0.0.1", 0)) as listener:
        listener.settimeout(_DEADLINE_S)

        def serve() -> None:
            for _ in range(2):
                accepted, _address = listener.accept()
                with accepted:
                    accepted.settimeout(_DEADLINE_S)
                    accepted.recv(65536)
                    accepted.sendall(answer)

        thread = threading.Thread(target=serve)
        thread.start()
        conversation = HttpConversation(listener.getsockname(), _DEADLINE_S, _DEADLINE_S)
        assert _ask(conversation) == Response(200, "", b"{}")
        while not head and not conversation.is_stale:
            time.sleep(0.01)
        assert _ask(conversation) == Response(200, "", b"{}")
        conversation.close()
        thread.join(_DEADLINE_S)
        assert not thread.is_alive()
