"""The door: engines that prove themselves come in, whoever else is there (docs/security.md)."""

from __future__ import annotations

import json
import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing

import pytest

from ludus.link import Door, Guest, Listener
from ludus.link.door import MAX_PENDING
from ludus.wire.greeting import Greeting
from tests.fake_engine import FLAT, HELLO, TOKEN, Talk
from tests.link.test_peer import CONNECT, NOBODY, program
from tests.wire.reference import json_frame

DEADLINE_S = 10.0


class Visitors:
    """A door, and those who come to it."""

    def __init__(self, stack: ExitStack) -> None:
        self._stack = stack
        listener = stack.enter_context(closing(Listener(("127.0.0.1", 0))))
        self.port = int(listener.addresses[-1].rpartition(":")[2])
        self.door = Door(listener.sockets, lambda: Greeting(TOKEN), 5.0)
        stack.enter_context(closing(self.door))

    def connect(self, said: bytes = b"") -> socket.socket:
        connection = socket.create_connection(("127.0.0.1", self.port), DEADLINE_S)
        self._stack.enter_context(connection)
        connection.sendall(said)
        return connection

    def look(self, seconds: float = 0.3) -> list[Guest]:
        """Keep the door for a while; return who has come in."""
        deadline = time.monotonic() + seconds
        guests: list[Guest] = []
        while time.monotonic() < deadline:
            guests += self.door.await_guests(0.02)
        return guests

    def game_comes_in(self, token: str = TOKEN) -> bool:
        """Let a game come that knows a token; return whether it was let in."""
        talk = Talk(self.connect(json_frame("HELLO", HELLO)), FLAT)
        self.look()
        talk.prove(token=token)
        guests = self.look()
        for guest in guests:
            guest.socket.close()
        return len(guests) == 1


@pytest.fixture
def visitors() -> Iterator[Visitors]:
    with ExitStack() as stack:
        yield Visitors(stack)


def test_a_game_that_proves_itself_comes_in(visitors: Visitors) -> None:
    assert visitors.game_comes_in()


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
    assert visitors.game_comes_in()


def test_a_stranger_that_reflects_our_proof_stays_out(visitors: Visitors) -> None:
    talk = Talk(visitors.connect(json_frame("HELLO", HELLO)), FLAT)
    visitors.look()
    challenge = json.loads(talk.read()[1])
    talk.json("PROOF", {"proof": challenge["proof"]})
    assert visitors.look() == []
    assert talk.read()[0] == "ERROR"


def test_a_game_with_another_token_stays_out(visitors: Visitors) -> None:
    assert not visitors.game_comes_in("another token of 16 characters")
    assert visitors.game_comes_in()


def test_a_crowd_of_silent_visitors_keeps_no_game_out(visitors: Visitors) -> None:
    for _ in range(2 * MAX_PENDING):
        visitors.connect()
        visitors.door.await_guests(0.0)
    assert visitors.game_comes_in()


def test_a_program_of_another_user_is_dropped_before_it_says_a_word(visitors: Visitors) -> None:
    with program(CONNECT, str(visitors.port), "4", user=NOBODY):
        assert visitors.look() == []
        assert visitors.game_comes_in()
        assert not visitors.door.num_pending


def test_one_that_takes_too_long_is_told_so() -> None:
    with ExitStack() as stack:
        listener = stack.enter_context(closing(Listener(("127.0.0.1", 0))))
        door = stack.enter_context(
            closing(Door(listener.sockets, lambda: Greeting(TOKEN), timeout_s=0.2))
        )
        port = int(listener.addresses[-1].rpartition(":")[2])
        half = stack.enter_context(socket.create_connection(("127.0.0.1", port), DEADLINE_S))
        half.sendall(json_frame("HELLO", HELLO)[:11])
        deadline = time.monotonic() + 1.0
        while time.monotonic() < deadline:
            assert door.await_guests(0.05) == []
        assert Talk(half, FLAT).read()[0] == "ERROR"


def test_where_both_have_unix_sockets_no_port_is_opened() -> None:
    with closing(Listener(has_tcp=False)) as listener:
        assert [address.partition(":")[0] for address in listener.addresses] == ["unix"]
        assert all(one.family == socket.AF_UNIX for one in listener.sockets)
