"""Sockets: cut and joined messages, strangers, silence, several clients, ports, the end."""

from __future__ import annotations

import json
import logging
import os
import re
import select
import socket
import struct
import threading
import time
from pathlib import Path
from typing import Any

import pytest

from ludus.errors import RunError, SetupError, TargetError
from ludus.serve.godot_ai.server import POLL_S, Server, ServerConfig
from tests.legacy.godot_ai.conftest import (
    DEADLINE_S,
    INIT,
    Client,
    Start,
    await_work,
    replays,
    saved_steps,
)

pytestmark = pytest.mark.slow
DONE = {"done": True}


def wait_for(pattern: str, caplog: pytest.LogCaptureFixture) -> None:
    """Wait until the server has logged something."""
    deadline = time.monotonic() + DEADLINE_S
    while not re.search(pattern, caplog.text) and time.monotonic() < deadline:
        time.sleep(0.02)
    assert re.search(pattern, caplog.text), caplog.text


def test_messages_byte_by_byte(client: Client) -> None:
    for byte in json.dumps({**INIT, "file_name": "žížala 1"}, ensure_ascii=False).encode():
        client.send(bytes([byte]))
    assert client.receive() == DONE
    assert "hero, žížala 1" in client.ask("load", file_name="x")["error"]


def test_two_messages_in_one_segment(client: Client) -> None:
    load = json.dumps({"command": "load", "file_name": "hero"}).encode()
    client.send(b" \n" + load + b"\r\n" + load + b'{"command": "train", "file_na')
    data = b""
    while data.count(b"}") < 2:
        data += client.socket.recv(100)
    assert data == b'{"done": true}' * 2
    client.send(b'me": "hero", "steps": 0}')
    assert client.receive() == DONE


@pytest.mark.parametrize(
    "data",
    [
        b"GET / HTTP/1.1\r\nHost: 127.0.0.1:9999\r\n\r\n",
        struct.pack("<IHBB", 64, 1, 0, 0) + b"x" * 64,  # a frame of our own protocol
        b"[1, 2, 3]",
        b'{"command": train}',
    ],
)
def test_strangers_are_told_and_dropped(start: Start, data: bytes) -> None:
    running = start()
    stranger, game = running.client(), running.client()
    stranger.send(data)
    assert "hint: something other than a godot-ai game" in stranger.receive()["error"]
    assert stranger.is_dropped()
    assert game.init() == DONE


def test_half_a_message_times_out(start: Start, caplog: pytest.LogCaptureFixture) -> None:
    running = start(message_timeout_s=1.0)
    idle, slow = running.client(), running.client()
    slow.send(b'{"command": ')
    deadline = time.monotonic() + DEADLINE_S / 2
    while not select.select([slow.socket], [], [], 0.25)[0]:  # a trickle does not help
        assert time.monotonic() < deadline
        slow.send(b" ")
    assert "the rest of a message did not come within 1 s" in slow.receive()["error"]
    assert slow.is_dropped()
    wait_for("was dropped", caplog)
    assert idle.init() == DONE, "silence between messages is no fault"


def test_endless_message_is_refused(start: Start) -> None:
    client = start().client()
    piece = b'{"command": "' + b"x" * 300_000
    client.send(piece)
    for _ in range(3):
        client.send(piece[:300_000].replace(b'"', b"x"))
    assert "a message of more than 1048576 bytes" in client.receive()["error"]
    assert client.is_dropped()


def test_a_client_that_goes_in_the_middle(start: Start, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    running = start()
    for data in (b"", b'{"command"'):
        client = running.client()
        client.send(data)
        wait_for(f":{client.socket.getsockname()[1]} connected", caplog)
        client.close()
    wait_for("in the middle of a message", caplog)
    assert running.client().init() == DONE


def test_a_client_that_does_not_wait_for_its_answers(
    start: Start, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    running = start()
    client = running.client()
    client.init()
    client.submit(replays(40))
    client.send(json.dumps({"command": "train", "file_name": "hero", "steps": 30}).encode())
    client.close()
    # What two clients say comes in no order.
    wait_for("has gone|closed the connection|the connection has ended", caplog)
    again = running.client()
    assert again.train(1) == DONE
    assert saved_steps(running.project) == 31


def test_several_clients_share_the_agents(start: Start) -> None:
    running = start()
    first, second = running.client(), running.client()
    first.init()
    second.init(file_name="target")
    assert first.train(0, name="target") == DONE
    assert second.init() == DONE
    first.submit(replays(20))
    results: list[Any] = []

    def train(client: Client) -> None:
        results.extend(client.train(3) for _ in range(5))

    threads = [threading.Thread(target=train, args=(client,)) for client in (first, second)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(DEADLINE_S)
    assert results == [DONE] * 10


def test_too_many_clients(project: Path) -> None:
    server = Server(ServerConfig(port=0, max_clients=2))
    is_stopping = threading.Event()

    class Echo:
        def answer(self, message: Any) -> Any:
            return message

        def close(self) -> None:
            is_stopping.set()

    thread = threading.Thread(target=server.run, args=(Echo(), is_stopping.is_set))
    thread.start()
    clients = [Client(server.port, project) for _ in range(2)]
    assert [client.ask("a") for client in clients] == [{"command": "a"}] * 2
    clients.append(Client(server.port, project))
    assert "2 clients are connected already" in clients[2].receive()["error"]
    clients[0].close()
    deadline = time.monotonic() + DEADLINE_S
    while time.monotonic() < deadline:
        clients.append(Client(server.port, project))
        try:
            answer = clients[-1].ask("b")
        except OSError:  # turned away before it had asked
            answer = {}
        if answer == {"command": "b"}:
            break
        time.sleep(POLL_S)
    else:
        pytest.fail("the place of the client that went was not given to another")
    is_stopping.set()
    thread.join(DEADLINE_S)
    for client in clients:
        client.close()


def test_silent_clients_keep_no_game_out(start: Start) -> None:
    running = start()
    silent = [running.client() for _ in range(64)]
    assert running.client().init() == DONE
    for client in silent:
        client.close()


def test_a_second_server_on_the_port(start: Start, tmp_path: Path) -> None:
    running = start()
    other = tmp_path / "other"
    other.mkdir()
    with pytest.raises(SetupError, match=f"127.0.0.1:{running.port}") as caught:
        start(port=running.port, project=other)
    assert "choose --port" in caught.value.hint
    assert running.client().init() == DONE


def test_a_second_server_of_the_project(start: Start) -> None:
    running = start()
    with pytest.raises(RunError, match="another ludus serve serves"):
        start()
    assert running.client().init() == DONE


def test_no_other_machine_can_connect(start: Start) -> None:
    running = start()
    probe = socket.socket()
    probe.bind(("127.0.0.2", running.port))  # so it does not listen on all addresses
    probe.close()


def test_stopping_ends_connections_and_training_and_saves(start: Start) -> None:
    running = start()
    client = running.client()
    client.init()
    client.submit(replays(40))
    assert client.train(1) == DONE
    client.send(json.dumps({"command": "train", "file_name": "hero", "steps": 10**6}).encode())
    await_work(os.getpid(), 0.5)
    running.stop()
    assert 1 < saved_steps(running.project) < 10**6


def test_folder_without_a_game_is_reported(
    start: Start, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with pytest.raises(TargetError, match="there is no folder"):
        start(project=tmp_path / "nowhere")
    with caplog.at_level(logging.WARNING):
        start(project=tmp_path)
    assert "has no project.godot" in caplog.text
