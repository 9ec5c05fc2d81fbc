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
from ludus.link.acceptor import MAX_PENDING
from ludus.serve.guided.game_server import (
    POLL_S,
    RELEASE_WAIT_S,
    ConnectedGame,
    GameServer,
)
from ludus.session.user_token import user_token
from ludus.wire.frames import FrameType
from tests.fake_engine import HELLO, TOKEN
from tests.serve.guided.conftest import Running, Start
from tests.serve.guided.game import CAPABILITIES, DEADLINE_S, Game
from tests.wire.reference import frame, json_frame, make_proof

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

    def prove(self, token: str = TOKEN) -> None:
        """Answer the challenge that follows the greeting."""
        head = self.socket.recv(8, socket.MSG_WAITALL)
        num_bytes, number = struct.unpack_from("<IB", head)
        payload = self.socket.recv(num_bytes, socket.MSG_WAITALL)
        assert number == FrameType.CHALLENGE, payload
        nonces = HELLO["nonce"], json.loads(payload)["nonce"]
        self.send(json_frame("PROOF", {"proof": make_proof(token, "engine", *nonces)}))

    def greet(self, **changes: Any) -> None:
        """Greet as a game that knows the token."""
        self.send(hello(**changes))
        self.prove()

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
    with GameServer(0, TOKEN, hello_timeout_s=DEADLINE_S, link_timeout_s=DEADLINE_S) as games:
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
    client.greet()
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
    client.prove(user_token())
    assert client.report() == BUSY
    game.await_state("standby")


@pytest.mark.parametrize(
    ("said", "code", "text"),
    [
        (b"GET / HTTP/1.1\r\n\r\n", "frame", "frame of unknown type 47"),
        (frame("SPEC", b"{}"), "frame", "the engine sent SPEC in CONNECTED"),
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
    if code == "config":  # of a game that has proved itself
        client.prove(user_token())
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
    assert silent.report()["message"] == "no complete greeting arrived within 1 s"
    seen = game.await_updates(0)["updates"]
    game.await_updates(seen + 3)


def test_a_hello_may_arrive_in_pieces(games: GameServer, connect: Connect) -> None:
    client = connect(games.port)
    data = hello()
    for i in range(0, len(data), 50):
        client.send(data[i : i + 50])
        time.sleep(0.002)
    client.prove()
    game = await_game(games)
    assert game.greeting.hello is not None
    assert game.greeting.hello.training == {"run": "other"}
    game.link.close()


def test_a_disconnect_not_yet_noticed_frees_the_place(games: GameServer, connect: Connect) -> None:
    first, game = connect_game(games, connect)
    first.send(b"something that nobody reads")
    first.socket.close()
    second = connect(games.port)
    second.greet(training={"run": "second"})
    await_reading(games, connect)
    third = connect(games.port)
    third.greet()
    assert third.report() == BUSY
    games.release()
    waiting = await_game(games, "second")
    game.link.close()
    waiting.link.close()


def test_a_game_waits_for_the_current_one_to_go(games: GameServer, connect: Connect) -> None:
    first, game = connect_game(games, connect)
    second = connect(games.port)
    second.greet(training={"run": "second"})
    await_reading(games, connect)
    time.sleep(2 * POLL_S)
    first.socket.close()
    waiting = await_game(games, "second")
    game.link.close()
    waiting.link.close()


def test_a_waiting_game_may_disconnect(games: GameServer, connect: Connect) -> None:
    _, game = connect_game(games, connect)
    second = connect(games.port)
    second.greet(training={"run": "second"})
    await_reading(games, connect)
    second.socket.close()
    time.sleep(2 * POLL_S)
    game.link.close()
    assert games.accept(2 * RELEASE_WAIT_S) is None


def test_a_waiting_game_that_disconnected_frees_the_place(
    games: GameServer, connect: Connect
) -> None:
    first, second = connect(games.port), connect(games.port)
    first.greet()
    await_reading(games, connect)
    first.socket.close()
    second.greet(training={"run": "second"})
    await_reading(games, connect)
    game = await_game(games, "second")
    game.link.close()


def test_a_crowd_of_silent_visitors_keeps_no_game_out(connect: Connect) -> None:
    with GameServer(0, TOKEN, hello_timeout_s=DEADLINE_S, link_timeout_s=5.0) as games:
        crowd = [connect(games.port) for _ in range(2 * MAX_PENDING + 3)]
        began = time.monotonic()
        _, game = connect_game(games, connect)
        assert time.monotonic() - began < DEADLINE_S / 2
        game.link.close()
        assert crowd[0].is_gone()  # who has been there longest


@pytest.mark.parametrize("token", ["another token of 16 characters", ""])
def test_a_game_with_another_token_is_rejected(
    games: GameServer, connect: Connect, token: str
) -> None:
    client = connect(games.port)
    client.send(hello())
    client.prove(token)
    assert client.report()["code"] == "token"
    _, game = connect_game(games, connect)
    game.link.close()


def test_a_game_of_protocol_1_is_rejected_and_told_what_to_do(
    games: GameServer, connect: Connect
) -> None:
    client = connect(games.port)
    client.send(hello(protocol={"min": 1, "max": 1}))
    report = client.report()
    assert report["code"] == "version"
    assert report["hint"] == "run `ludus addon install PROJECT`"


def test_the_server_sleeps_without_connections(connect: Connect) -> None:
    with GameServer(0, TOKEN, hello_timeout_s=0.5, link_timeout_s=5.0) as games:
        connect(games.port).send(hello()[:30])
        began, used = time.monotonic(), time.process_time()
        assert games.accept(2.0) is None
        assert time.monotonic() - began >= 2.0
        assert time.process_time() - used < 0.5


def test_a_taken_port_is_an_error(games: GameServer) -> None:
    with pytest.raises(SetupError, match=f"cannot listen at 127.0.0.1:{games.port}") as caught:
        GameServer(games.port, TOKEN, 1.0, 1.0)
    assert "choose another --port" in caught.value.hint
