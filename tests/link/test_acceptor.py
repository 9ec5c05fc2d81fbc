"""Engines that prove themselves are accepted, whatever else connects (docs/security.md)."""

from __future__ import annotations

import json
import select
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing

import pytest

from ludus.link import EngineAcceptor, Listener, PendingConnection
from ludus.link.acceptor import MAX_PENDING
from ludus.wire.greeting import Greeting
from tests.fake_engine import FLAT, HELLO, TOKEN, Talk
from tests.link.test_peer import CONNECT, NOBODY, program
from tests.wire.reference import json_frame, make_proof

DEADLINE_S = 10.0


class Visitors:
    """An acceptor, and the clients that connect to it."""

    def __init__(self, stack: ExitStack) -> None:
        self._stack = stack
        listener = stack.enter_context(closing(Listener(("127.0.0.1", 0))))
        self.port = int(listener.addresses[-1].rpartition(":")[2])
        self.acceptor = EngineAcceptor(listener.sockets, lambda: Greeting(TOKEN), 5.0)
        stack.enter_context(closing(self.acceptor))

    def connect(self, said: bytes = b"") -> socket.socket:
        connection = socket.create_connection(("127.0.0.1", self.port), DEADLINE_S)
        self._stack.enter_context(connection)
        connection.sendall(said)
        return connection

    def look(
        self,
        seconds: float = 0.3,
        until: Callable[[list[PendingConnection]], object] = lambda proven: False,
    ) -> list[PendingConnection]:
        """Accept for a while, or until something holds; return who has proved itself."""
        deadline = time.monotonic() + seconds
        proven: list[PendingConnection] = []
        while time.monotonic() < deadline and not until(proven):
            proven += self.acceptor.await_proven(0.02)
        return proven

    def is_game_accepted(self, token: str = TOKEN) -> bool:
        """Connect a game that knows a token; return whether it was accepted."""
        connection = self.connect(json_frame("HELLO", HELLO))
        talk = Talk(connection, FLAT)
        self.look(until=lambda _: select.select([connection], [], [], 0)[0])
        talk.prove(token=token)
        proven = self.look(until=len)
        for one in proven:
            one.socket.close()
        return len(proven) == 1


@pytest.fixture
def visitors() -> Iterator[Visitors]:
    with ExitStack() as stack:
        yield Visitors(stack)


def test_a_game_that_proves_itself_comes_in(visitors: Visitors) -> None:
    assert visitors.is_game_accepted()


@pytest.mark.parametrize(
    "said",
    [
        b"",
        b"\x05\x00\x00",
        b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n",
        bytes(100_000),
        b"\xff" * 8,
        json_frame("HELLO", HELLO)[:-3],
        json_frame("HELLO", {**HELLO, "protocol": {"min": 1, "max": 1}}),
        json_frame("HELLO", {**HELLO, "protocol": {"min": 8, "max": 9}}),
        json_frame("HELLO", HELLO) + json_frame("PROOF", {"proof": "0" * 64}),
    ],
)
def test_a_stranger_that_comes_first_is_not_the_game(visitors: Visitors, said: bytes) -> None:
    visitors.connect(said)
    assert visitors.look() == []
    assert visitors.is_game_accepted()


def test_a_stranger_that_reflects_our_proof_stays_out(visitors: Visitors) -> None:
    talk = Talk(visitors.connect(json_frame("HELLO", HELLO)), FLAT)
    visitors.look()
    challenge = json.loads(talk.read()[1])
    talk.json("PROOF", {"proof": challenge["proof"]})
    assert visitors.look() == []
    assert talk.read()[0] == "ERROR"


def test_a_refusal_proves_that_it_is_ours(visitors: Visitors) -> None:
    hello = {**HELLO, "protocol": {"min": 8, "max": 9}}
    talk = Talk(visitors.connect(json_frame("HELLO", hello)), FLAT)
    visitors.look()
    name, payload = talk.read()
    assert name == "ERROR"
    report = json.loads(payload)
    expected = make_proof(TOKEN, "trainer", HELLO["nonce"], report["nonce"])
    assert (report["code"], report["proof"]) == ("version", expected)


def test_a_game_with_another_token_stays_out(visitors: Visitors) -> None:
    assert not visitors.is_game_accepted("another token of 16 characters")
    assert visitors.is_game_accepted()


def test_a_crowd_of_silent_visitors_keeps_no_game_out(visitors: Visitors) -> None:
    for _ in range(2 * MAX_PENDING):
        visitors.connect()
        visitors.acceptor.await_proven(0.0)
    assert visitors.is_game_accepted()


def test_a_program_of_another_user_is_dropped_before_it_says_a_word(visitors: Visitors) -> None:
    with program(CONNECT, str(visitors.port), "4", user=NOBODY):
        assert visitors.look() == []
        assert visitors.is_game_accepted()
        assert not visitors.acceptor.num_pending


def test_one_that_takes_too_long_is_told_so() -> None:
    with ExitStack() as stack:
        listener = stack.enter_context(closing(Listener(("127.0.0.1", 0))))
        acceptor = stack.enter_context(
            closing(EngineAcceptor(listener.sockets, lambda: Greeting(TOKEN), timeout_s=0.2))
        )
        port = int(listener.addresses[-1].rpartition(":")[2])
        half = stack.enter_context(socket.create_connection(("127.0.0.1", port), DEADLINE_S))
        half.sendall(json_frame("HELLO", HELLO)[:11])
        deadline = time.monotonic() + 1.0
        while time.monotonic() < deadline:
            assert acceptor.await_proven(0.05) == []
        assert Talk(half, FLAT).read()[0] == "ERROR"


def test_where_both_have_unix_sockets_no_port_is_opened() -> None:
    with closing(Listener(has_tcp=False)) as listener:
        assert [address.partition(":")[0] for address in listener.addresses] == ["unix"]
        assert all(one.family == socket.AF_UNIX for one in listener.sockets)
