"""Which connections ludus serve accepts, and that others do not disturb the game being trained."""

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
from ludus.serve.guided.game_server import (
    MAX_PENDING,
    POLL_S,
    RELEASE_WAIT_S,
    ConnectedGame,
    GameServer,
)
from ludus.serve.guided.pending_connection import LINGER_S
from tests.fake_engine import HELLO
from tests.serve.guided.conftest import Running, Start
from tests.serve.guided.game import CAPABILITIES, DEADLINE_S, Game
from tests.wire.reference import frame, json_frame

pytestmark = pytest.mark.slow
BUSY = {
    "code": "busy",
    "message": "another game is being trained",
    "hint": "wait until it has ended, or start another ludus serve at another --port",
}


class Client:
    """A connection that sends what the test wants."""

    def __init__(self, port: int) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port), DEADLINE_S)

    def send(self, data: bytes) -> None:
        self.socket.sendall(data)

    def read_all(self) -> bytes:
        """Return what arrives until the server disconnects."""
        data = b""
        while piece := self.socket.recv(4096):
            data += piece
        return data

    def report(self) -> dict[str, Any]:
        data = self.read_all()
        num_bytes, number = struct.unpack_from("<IB", data)
        assert (number, len(data)) == (11, 8 + num_bytes)
        return json.loads(data[8:])

    def is_gone(self) -> bool:
        try:
            return self.read_all() == b""
        except ConnectionError:
            return True


@pytest.fixture
def games() -> Iterator[GameServer]:
    with GameServer(0, hello_timeout_s=DEADLINE_S, link_timeout_s=DEADLINE_S) as games:
        yield games


Connect = Callable[[int], Client]


@pytest.fixture
def connect() -> Iterator[Connect]:
    """Connects clients, and closes their connections."""
    with ExitStack() as stack:

        def one(port: int) -> Client:
            client = Client(port)
            stack.enter_context(client.socket)
            return client

        yield one


def await_reading(games: GameServer, connect: Connect) -> None:
    """Wait until the server has read everything sent to it so far."""
    client = connect(games.port)
    client.send(b"GET / HTTP/1.1\r\n\r\n")
    assert client.report()["code"] == "frame"


def await_game(games: GameServer, run: str = "other") -> ConnectedGame:
    game = games.accept(DEADLINE_S)
    assert game is not None
    assert game.training.run == run
    return game


def connect_game(games: GameServer, connect: Connect) -> tuple[Client, ConnectedGame]:
    client = connect(games.port)
    client.send(hello())
    return client, await_game(games)


def hello(**changes: Any) -> bytes:
    hello = {**HELLO, "capabilities": CAPABILITIES, "training": {"run": "other"}, **changes}
    return json_frame("HELLO", hello)


def test_a_second_game_is_rejected_during_training(server: Running) -> None:
    game = server.training()
    second = Game(server.port, {"run": "other"})
    second.await_the_end()
    assert second.report == BUSY
    before = game.await_updates(0)["updates"]
    game.await_updates(before + 2)
    assert not server.folder("other").path.exists()


def test_a_second_game_is_rejected_while_the_first_stands_by(
    server: Running, connect: Connect
) -> None:
    game = server.game()
    game.await_state("standby")
    client = connect(server.port)
    client.send(hello())
    assert client.report() == BUSY
    game.await_state("standby")


@pytest.mark.parametrize(
    ("said", "code", "text"),
    [
        (b"GET / HTTP/1.1\r\n\r\n", "frame", "frame of unknown type 47"),
        (frame("SPEC", b"{}"), "frame", "the first frame must be HELLO, got SPEC"),
        (frame("HELLO", b"[1]"), "frame", "HELLO must be a JSON object"),
        (frame("HELLO", b"\xff\xfe"), "frame", "HELLO is not valid JSON"),
        (frame("HELLO", b"{}"), "frame", "HELLO.protocol: missing"),
        (struct.pack("<IBBH", 1 << 25, 1, 0, 0), "frame", "HELLO frame of 33554432 bytes"),
        (hello(training=7), "config", "HELLO.training: expected an object, got 7"),
        (hello(training={"run": "../x"}), "config", "HELLO.training.run: expected 1 to 64"),
        (hello(training={"num_worlds": 0}), "config", "HELLO.training.num_worlds"),
        (hello(protocol={"min": 7, "max": 9}), "version", "the Python package is too old"),
    ],
)
def test_a_wrong_hello_is_answered_with_the_error(
    server: Running, said: bytes, code: str, text: str, connect: Connect
) -> None:
    client = connect(server.port)
    client.send(said)
    report = client.report()
    assert report["code"] == code
    assert text in report["message"]
    server.game().await_state("standby")


def test_other_clients_do_not_disturb_a_game(start: Start, connect: Connect) -> None:
    server = start(hello_timeout_s=1.0)
    game = server.training()
    silent, half, odd, gone = (connect(server.port) for _ in range(4))
    half.send(hello()[:-10])
    odd.send(b"\x00" * 100_000)
    gone.send(hello()[:20])
    gone.socket.close()
    seen = game.await_updates(0)["updates"]
    game.await_updates(seen + 3)
    assert half.report()["code"] == "timeout"
    assert silent.report()["message"] == "no complete HELLO arrived within 1 s"
    seen = game.await_updates(0)["updates"]
    game.await_updates(seen + 3)


def test_a_hello_may_arrive_in_pieces(games: GameServer, connect: Connect) -> None:
    client = connect(games.port)
    data = hello()
    for i in range(0, len(data), 50):
        client.send(data[i : i + 50])
        time.sleep(0.002)
    game = await_game(games)
    name, payload = game.link.receive()
    assert (int(name), json.loads(payload)["training"]) == (1, {"run": "other"})
    game.link.close()


def test_a_disconnect_not_yet_noticed_frees_the_place(games: GameServer, connect: Connect) -> None:
    first, game = connect_game(games, connect)
    first.send(b"something that nobody reads")
    first.socket.close()
    second = connect(games.port)
    second.send(hello(training={"run": "second"}))
    await_reading(games, connect)
    third = connect(games.port)
    third.send(hello())
    assert third.report() == BUSY
    games.release()
    waiting = await_game(games, "second")
    game.link.close()
    waiting.link.close()


def test_a_game_waits_for_the_current_one_to_go(games: GameServer, connect: Connect) -> None:
    first, game = connect_game(games, connect)
    second = connect(games.port)
    second.send(hello(training={"run": "second"}))
    await_reading(games, connect)
    time.sleep(2 * POLL_S)
    first.socket.close()
    waiting = await_game(games, "second")
    game.link.close()
    waiting.link.close()


def test_a_waiting_game_may_disconnect(games: GameServer, connect: Connect) -> None:
    _, game = connect_game(games, connect)
    second = connect(games.port)
    second.send(hello(training={"run": "second"}))
    await_reading(games, connect)
    second.socket.close()
    time.sleep(2 * POLL_S)
    game.link.close()
    assert games.accept(2 * RELEASE_WAIT_S) is None


def test_a_waiting_game_that_disconnected_frees_the_place(
    games: GameServer, connect: Connect
) -> None:
    first, second = connect(games.port), connect(games.port)
    first.send(hello())
    await_reading(games, connect)
    first.socket.close()
    second.send(hello(training={"run": "second"}))
    await_reading(games, connect)
    game = await_game(games, "second")
    game.link.close()


def test_connections_beyond_the_limit_are_dropped(connect: Connect) -> None:
    with GameServer(0, hello_timeout_s=3.0, link_timeout_s=5.0) as games:
        crowd = [connect(games.port) for _ in range(MAX_PENDING + 3)]
        assert all(one.is_gone() for one in crowd[MAX_PENDING:])
        assert all(one.report()["code"] == "timeout" for one in crowd[:MAX_PENDING])
        for one in crowd:
            one.socket.close()
        time.sleep(2 * LINGER_S)
        late = connect(games.port)
        late.send(hello())
        await_game(games).link.close()


def test_the_server_sleeps_without_connections(connect: Connect) -> None:
    with GameServer(0, hello_timeout_s=0.5, link_timeout_s=5.0) as games:
        connect(games.port).send(hello()[:30])
        began, used = time.monotonic(), time.process_time()
        assert games.accept(2.0) is None
        assert time.monotonic() - began >= 2.0
        assert time.process_time() - used < 0.5


def test_a_taken_port_is_an_error(games: GameServer) -> None:
    with pytest.raises(SetupError, match=f"cannot listen at 127.0.0.1:{games.port}") as caught:
        GameServer(games.port, 1.0, 1.0)
    assert "choose another --port" in caught.value.hint
