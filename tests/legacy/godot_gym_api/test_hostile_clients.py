"""Whatever a client does, the game in a real Godot 3 says what is wrong and serves the next one."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import socket
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psutil
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ludus.engine import EngineProcess, LaunchConfig
from ludus.legacy.godot_gym_api import GodotClient
from ludus.legacy.godot_gym_api.connecting import free_port
from ludus.legacy.launching import GameLaunch
from tests.legacy.godot_gym_api.conftest import ALL

pytestmark = pytest.mark.engine

MIB = 1 << 20
JUNK: st.SearchStrategy[Any] = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=3),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner),
    max_leaves=8,
)
SETTINGS = st.dictionaries(st.sampled_from(["repeat_action", "time_speed", "x"]), JUNK)
CONFIGS = st.dictionaries(
    st.sampled_from(["agent", "world", "environment", "x"]), SETTINGS | JUNK, max_size=3
)
OBSERVATIONS = st.dictionaries(
    st.sampled_from(["agent", "world", "x"]), st.lists(JUNK, max_size=3), max_size=3
)
REQUESTS = st.fixed_dictionaries(
    {},
    optional={
        "config": CONFIGS | JUNK,
        "reset": JUNK,
        "observation": OBSERVATIONS | JUNK,
        "other": JUNK,
    },
)
PAYLOADS = st.binary(max_size=40) | (REQUESTS | JUNK).map(lambda value: json.dumps(value).encode())


@dataclass
class Game:
    """A game that runs for all tests of this file."""

    address: tuple[str, int]
    process: EngineProcess

    def connect(self) -> socket.socket:
        return socket.create_connection(self.address, 20.0)

    def serves(self) -> bool:
        """Whether a client that behaves is served, exactly."""
        with GodotClient(None, self.address, start_timeout_s=20.0, step_timeout_s=20.0) as client:
            client.set_repeat_action(3)
            client.reset(ALL)
            return client.step(1.0, ALL)["world"].frames == 3

    def said(self, what: str) -> bool:
        deadline = time.monotonic() + 30.0
        while time.monotonic() < deadline:
            if any(what in line for line in self.process.last_lines()):
                return True
            time.sleep(0.05)
        return False

    def rss_bytes(self) -> int:
        return psutil.Process(self.process.pid).memory_info().rss


@pytest.fixture(scope="module")
def game(project: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Game]:
    log_path = tmp_path_factory.mktemp("hostile") / "log"
    with (
        free_port("127.0.0.1") as port,
        EngineProcess.start(
            LaunchConfig(command=command(project, port), log_path=log_path)
        ) as process,
    ):
        game = Game(("127.0.0.1", port), process)
        assert game.serves()
        yield game
        assert game.serves()
    # The game also quotes what it was sent, which may be these very words.
    lines = log_path.read_text(errors="replace").splitlines()
    failures = [i for i, line in enumerate(lines) if line.startswith("SCRIPT ERROR")]
    assert [lines[i : i + 2] for i in failures] == []


def command(project: Path, port: int) -> tuple[str, ...]:
    return GameLaunch(target=project).command_line((f"--ludus-port={port}",))


def frame(payload: bytes) -> bytes:
    return len(payload).to_bytes(4, "little") + payload


def is_sent_away(connection: socket.socket) -> bool:
    """Whether the game closes the connection; an answer before would be an error."""
    connection.settimeout(30.0)
    try:
        return connection.recv(1) == b""
    except ConnectionError:
        return True


def read_answer(connection: socket.socket) -> dict[str, object]:
    file = connection.makefile("rb")
    return json.loads(file.read(int.from_bytes(file.read(4), "little")))


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"\0\0\0\0", "a request of 0 bytes, expected 1 to 16777216"),
        (b"\xff\xff\xff\xff", "a request of 4294967295 bytes"),
        (b"\x01\0\0\x01", "a request of 16777217 bytes"),
        (b"GET / HTTP/1.1\r\n\r\n", "a request of 542393671 bytes"),
        (
            frame(b"this is text"),
            "a request must be a JSON object, this came: this is text",
        ),
        (frame(b"[1]"), "a request must be a JSON object, this came: [1]"),
        (frame(b'{"action": NaN, "observation": {}}'), "a request must be a JSON object"),
        (frame(b"\xff\xfe\0\0"), "a request must be a JSON object"),
        (frame(b'{"seed": 1}'), "a request needs one of"),
        (frame(b'{"observation": 1}'), "observation must be an object"),
        (
            frame(b'{"config": {"environment": {"repeat_action": 0}}}'),
            "config.environment.repeat_action must be",
        ),
        (
            frame(b'{"config": {"environment": {"time_speed": 1e999}}}'),
            "config.environment.time_speed must be",
        ),
        (frame(b'{"action": ' + b"[" * 100_000), "a request is nested more than 1000 deep"),
    ],
)
def test_what_is_no_request(game: Game, data: bytes, said: str) -> None:
    with game.connect() as connection:
        connection.sendall(data)
        assert is_sent_away(connection)
    assert game.said(f"the client was sent away: {said}")
    assert game.serves()


@settings(max_examples=120, deadline=None)
@given(payload=PAYLOADS)
def test_any_request_is_json_or_refused(game: Game, payload: bytes) -> None:
    """It is answered, or ignored, or ends the connection."""
    with game.connect() as connection, contextlib.suppress(ConnectionError):
        connection.sendall(frame(payload) + frame(b'{"observation": {"moon": 1}}'))
        received = b""
        while not received.endswith(frame(b"{}")) and (piece := connection.recv(4096)):
            received += piece
        assert len(received) < 4096


@settings(max_examples=40, deadline=None)
@given(data=st.binary(max_size=60))
def test_any_bytes_are_cut_within_the_limit(game: Game, data: bytes) -> None:
    with game.connect() as connection, contextlib.suppress(OSError):  # gone before shutdown()
        connection.sendall(data)
        connection.shutdown(socket.SHUT_WR)
        while connection.recv(4096):
            pass


def test_unknown_keys_do_no_harm(game: Game) -> None:
    with game.connect() as connection:
        connection.sendall(frame(b'{"seed": 3, "observation": {"agent": [], "moon": 1}}'))
        assert list(read_answer(connection)) == ["agent_data"]
    assert game.said("the request has unknown keys: [seed]")


@pytest.mark.parametrize("data", [b"\x20", frame(b'{"reset": 1}')[:-1]], ids=["length", "request"])
def test_half_a_request_for_ever(game: Game, data: bytes) -> None:
    with game.connect() as connection:
        began = time.monotonic()
        connection.sendall(data)
        assert is_sent_away(connection)
        assert 3.0 < time.monotonic() - began < 20.0
    assert game.said(f"did not come whole within 5 s: {len(data)} of")
    assert game.serves()


def test_half_a_request_after_a_whole_one(game: Game) -> None:
    """Where the game waits in one call of the system, without looking at the clock."""
    with game.connect() as connection:
        connection.sendall(frame(b'{"observation": {}}'))
        assert read_answer(connection) == {}
        connection.sendall(b"\x07\0")
        assert is_sent_away(connection)
    assert game.serves()


def test_a_request_a_byte_at_a_time(game: Game) -> None:
    with game.connect() as connection:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        for _ in range(2):
            for byte in frame(b'{"reset": 1, "observation": {"world": []}}'):
                connection.sendall(bytes([byte]))
                time.sleep(0.002)
            assert "world_data" in read_answer(connection)


def test_requests_in_one_piece(game: Game) -> None:
    with game.connect() as connection:
        connection.sendall(frame(b'{"observation": {}}') * 20)
        file = connection.makefile("rb")
        assert file.read(20 * 6) == frame(b"{}") * 20


def test_a_large_request_in_bounded_memory(game: Game) -> None:
    before_bytes = game.rss_bytes()
    with game.connect() as connection:
        connection.sendall((16 * MIB).to_bytes(4, "little") + b" " * (16 * MIB - 3) + b"{")
        connection.shutdown(socket.SHUT_WR)
        assert is_sent_away(connection)
    assert game.serves()
    assert game.rss_bytes() - before_bytes < 256 * MIB


def leave_at_once(connection: socket.socket) -> None:
    connection.close()


def leave_during_a_step(connection: socket.socket) -> None:
    connection.sendall(frame(b'{"action": 1, "observation": {"agent": []}}'))
    connection.close()


def leave_during_a_long_step(connection: socket.socket) -> None:
    config = b'"config": {"environment": {"repeat_action": 1000000}}'
    connection.sendall(frame(b'{"action": 1, ' + config + b', "observation": {}}'))
    time.sleep(1.5)
    connection.close()


def leave_in_the_middle(connection: socket.socket) -> None:
    connection.sendall(frame(b'{"reset": 1}')[:7])
    connection.close()


@pytest.mark.parametrize(
    "leave", [leave_at_once, leave_during_a_step, leave_during_a_long_step, leave_in_the_middle]
)
def test_a_client_that_leaves(game: Game, leave: Callable[[socket.socket], None]) -> None:
    for _ in range(2):
        with game.connect() as connection:
            leave(connection)
    assert game.serves()


def test_nothing_moves_when_nobody_waits_for_it(game: Game) -> None:
    with game.connect() as connection:
        leave_during_a_long_step(connection)
    with GodotClient(None, game.address, step_timeout_s=20.0) as client:
        seen = [client.request({"observation": ALL})["world"].frames for _ in range(20)]
        assert seen[0] > 0
        assert set(seen) == {seen[0]}


def test_a_second_client_waits(game: Game) -> None:
    with game.connect() as first, game.connect() as second:
        first.sendall(frame(b'{"observation": {}}'))
        assert read_answer(first) == {}
        second.sendall(frame(b'{"observation": {}}'))
        for _ in range(20):  # the game looks for others now and then
            first.sendall(frame(b'{"observation": {}}'))
            assert read_answer(first) == {}
        second.settimeout(0.5)
        with pytest.raises(TimeoutError):
            second.recv(1)
        assert game.said("Another client waits until this one has gone.")
        first.close()
        second.settimeout(30.0)
        assert read_answer(second) == {}
    assert game.serves()


def test_a_silent_client_gives_way(game: Game) -> None:
    with game.connect() as silent:
        time.sleep(0.3)
        assert game.serves()
        assert game.said("it has asked nothing, and another one waits")
        assert is_sent_away(silent)


def test_an_answer_that_nobody_reads(game: Game) -> None:
    """More than the system keeps: the game gives up after 5 seconds."""
    request = frame(b'{"observation": {"agent": ["all"], "world": []}}')
    with socket.socket() as connection:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        connection.connect(game.address)
        connection.settimeout(1.0)
        with pytest.raises((TimeoutError, ConnectionError)):
            for _ in range(20_000):
                connection.sendall(request * 50)
        assert game.said("it does not read its answer: ")
    assert game.serves()


def test_ctrl_c_while_it_waits(game: Game, project: Path) -> None:
    with (
        free_port("127.0.0.1") as port,
        EngineProcess.start(LaunchConfig(command=command(project, port))) as process,
        GodotClient(None, ("127.0.0.1", port), start_timeout_s=20.0) as client,
    ):
        client.reset(ALL)
        time.sleep(0.3)
        os.kill(process.pid, signal.SIGINT)
        assert process.wait(20.0) is not None
    assert game.serves()
