"""Who may come in, and that nobody who knocks disturbs the game that is being trained."""

from __future__ import annotations

import json
import socket
import struct
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any

import pytest

from ludus.errors import SetupError
from ludus.serve.guided.door import MAX_GUESTS, PATIENCE_S, POLL_S, Door, Visitor
from ludus.serve.guided.guest import LINGER_S
from tests.fake_engine import HELLO
from tests.serve.guided.conftest import Running, Start
from tests.serve.guided.game import CAPABILITIES, DEADLINE_S, Game
from tests.wire.reference import frame, json_frame

BUSY = {
    "code": "busy",
    "message": "another game is being trained",
    "hint": "wait until it has ended, or start another ludus serve at another --port",
}


class Stranger:
    """A connection that says what the test wants."""

    def __init__(self, port: int) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port), DEADLINE_S)

    def say(self, data: bytes) -> None:
        self.socket.sendall(data)

    def hear_all(self) -> bytes:
        """Return what comes until the server hangs up."""
        data = b""
        while piece := self.socket.recv(4096):
            data += piece
        return data

    def report(self) -> dict[str, Any]:
        data = self.hear_all()
        num_bytes, number = struct.unpack_from("<IB", data)
        assert (number, len(data)) == (11, 8 + num_bytes)
        return json.loads(data[8:])

    def is_gone(self) -> bool:
        try:
            return self.hear_all() == b""
        except ConnectionError:
            return True


@pytest.fixture
def door() -> Iterator[Door]:
    with Door(0, hello_timeout_s=DEADLINE_S, link_timeout_s=DEADLINE_S) as door:
        yield door


Knock = Callable[[int], Stranger]


@pytest.fixture
def knock() -> Iterator[Knock]:
    """Makes strangers, and closes their connections."""
    with ExitStack() as stack:

        def one(port: int) -> Stranger:
            stranger = Stranger(port)
            stack.enter_context(stranger.socket)
            return stranger

        yield one


def await_hearing(door: Door, knock: Knock) -> None:
    """Wait until the door has heard all that was said to it so far."""
    stranger = knock(door.port)
    stranger.say(b"GET / HTTP/1.1\r\n\r\n")
    assert stranger.report()["code"] == "frame"


def await_visitor(door: Door, run: str = "other") -> Visitor:
    visitor = door.let_in(DEADLINE_S)
    assert visitor is not None
    assert visitor.training.run == run
    return visitor


def come_in(door: Door, knock: Knock) -> tuple[Stranger, Visitor]:
    stranger = knock(door.port)
    stranger.say(greeting())
    return stranger, await_visitor(door)


def greeting(**changes: Any) -> bytes:
    hello = {**HELLO, "capabilities": CAPABILITIES, "training": {"run": "other"}, **changes}
    return json_frame("HELLO", hello)


def test_a_second_game_is_told_soon(server: Running) -> None:
    game = server.training()
    second = Game(server.port, {"run": "other"})
    second.await_the_end()
    assert second.report == BUSY
    before = game.await_updates(0)["updates"]
    game.await_updates(before + 2)
    assert not server.folder("other").path.exists()


def test_a_second_game_is_turned_away_while_the_first_stands_by(
    server: Running, knock: Knock
) -> None:
    game = server.game()
    game.await_state("standby")
    stranger = knock(server.port)
    stranger.say(greeting())
    assert stranger.report() == BUSY
    game.await_state("standby")


@pytest.mark.parametrize(
    ("said", "code", "text"),
    [
        (b"GET / HTTP/1.1\r\n\r\n", "frame", "frame of unknown type 47"),
        (frame("SPEC", b"{}"), "frame", "a game begins with HELLO, SPEC came"),
        (frame("HELLO", b"[1]"), "frame", "HELLO must be a JSON object"),
        (frame("HELLO", b"\xff\xfe"), "frame", "HELLO is not valid JSON"),
        (frame("HELLO", b"{}"), "frame", "malformed HELLO"),
        (struct.pack("<IBBH", 1 << 25, 1, 0, 0), "frame", "HELLO frame of 33554432 bytes"),
        (greeting(training=7), "config", "HELLO.training: expected an object, got 7"),
        (greeting(training={"run": "../x"}), "config", "HELLO.training.run: expected 1 to 64"),
        (greeting(training={"num_worlds": 0}), "config", "HELLO.training.num_worlds"),
        (greeting(protocol={"min": 7, "max": 9}), "version", "the Python package is too old"),
    ],
)
def test_a_stranger_is_told_what_is_wrong(
    server: Running, said: bytes, code: str, text: str, knock: Knock
) -> None:
    stranger = knock(server.port)
    stranger.say(said)
    report = stranger.report()
    assert report["code"] == code
    assert text in report["message"]
    server.game().await_state("standby")


def test_strangers_do_not_disturb_a_game(start: Start, knock: Knock) -> None:
    server = start(hello_timeout_s=1.0)
    game = server.training()
    silent, half, odd, gone = (knock(server.port) for _ in range(4))
    half.say(greeting()[:-10])
    odd.say(b"\x00" * 100_000)
    gone.say(greeting()[:20])
    gone.socket.close()
    seen = game.await_updates(0)["updates"]
    game.await_updates(seen + 3)
    assert half.report()["code"] == "timeout"
    assert silent.report()["message"] == "no whole HELLO came within 1 s"
    seen = game.await_updates(0)["updates"]
    game.await_updates(seen + 3)


def test_a_greeting_in_pieces(door: Door, knock: Knock) -> None:
    stranger = knock(door.port)
    data = greeting()
    for i in range(0, len(data), 50):
        stranger.say(data[i : i + 50])
        time.sleep(0.002)
    visitor = await_visitor(door)
    name, payload = visitor.link.receive()
    assert (int(name), json.loads(payload)["training"]) == (1, {"run": "other"})
    visitor.link.close()


def test_a_game_that_hung_up_unnoticed_makes_room(door: Door, knock: Knock) -> None:
    first, visitor = come_in(door, knock)
    first.say(b"something that nobody reads")
    first.socket.close()
    second = knock(door.port)
    second.say(greeting(training={"run": "second"}))
    await_hearing(door, knock)
    third = knock(door.port)
    third.say(greeting())
    assert third.report() == BUSY
    door.let_out()
    waiting = await_visitor(door, "second")
    visitor.link.close()
    waiting.link.close()


def test_a_game_that_comes_before_the_first_hangs_up(door: Door, knock: Knock) -> None:
    first, visitor = come_in(door, knock)
    second = knock(door.port)
    second.say(greeting(training={"run": "second"}))
    await_hearing(door, knock)
    time.sleep(2 * POLL_S)
    first.socket.close()
    waiting = await_visitor(door, "second")
    visitor.link.close()
    waiting.link.close()


def test_one_who_is_told_to_wait_may_leave(door: Door, knock: Knock) -> None:
    _, visitor = come_in(door, knock)
    second = knock(door.port)
    second.say(greeting(training={"run": "second"}))
    await_hearing(door, knock)
    second.socket.close()
    time.sleep(2 * POLL_S)
    visitor.link.close()
    assert door.let_in(2 * PATIENCE_S) is None


def test_one_who_waited_and_left_makes_room(door: Door, knock: Knock) -> None:
    first, second = knock(door.port), knock(door.port)
    first.say(greeting())
    await_hearing(door, knock)
    first.socket.close()
    second.say(greeting(training={"run": "second"}))
    await_hearing(door, knock)
    visitor = await_visitor(door, "second")
    visitor.link.close()


def test_a_crowd_is_dropped(knock: Knock) -> None:
    with Door(0, hello_timeout_s=3.0, link_timeout_s=5.0) as door:
        crowd = [knock(door.port) for _ in range(MAX_GUESTS + 3)]
        assert all(one.is_gone() for one in crowd[MAX_GUESTS:])
        assert all(one.report()["code"] == "timeout" for one in crowd[:MAX_GUESTS])
        for one in crowd:
            one.socket.close()
        time.sleep(2 * LINGER_S)
        late = knock(door.port)
        late.say(greeting())
        await_visitor(door).link.close()


def test_the_door_sleeps_while_nobody_knocks(knock: Knock) -> None:
    with Door(0, hello_timeout_s=0.5, link_timeout_s=5.0) as door:
        knock(door.port).say(greeting()[:30])
        began, used = time.monotonic(), time.process_time()
        assert door.let_in(2.0) is None
        assert time.monotonic() - began >= 2.0
        assert time.process_time() - used < 0.5


def test_a_port_that_is_taken(door: Door) -> None:
    with pytest.raises(SetupError, match=f"cannot listen at 127.0.0.1:{door.port}") as caught:
        Door(door.port, 1.0, 1.0)
    assert "choose another --port" in caught.value.hint
