"""The game's side of GymGodot's wire as a small program, for tests without an engine.

``python -m tests.legacy.gymgodot.fake_game NAME --serverIP=… --serverPort=… --renderPath=…``
connects and plays. The name chooses what it does: ``walk`` is right, ``replay`` answers what a real
game answered, everything else goes wrong in its third step, or before it has connected.
"""

from __future__ import annotations

import json
import os
import socket
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from PIL import Image
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

CONVERSATION = Path(__file__).with_name("cartpole.jsonl")
FAULTY_STEP = 3
HUGE = 1 << 20


class Walk:
    """A point on a line: position and number of steps; done beyond 3."""

    def __init__(self, name: str, render_path: str) -> None:
        self._name = name
        self._render_path = render_path
        self._position = 0.0
        self._num_steps = 0
        self._num_frames = 0

    def answer(self, link: ClientConnection, request: dict[str, Any]) -> None:
        answers: dict[str, Callable[[], Any]] = {
            "reset": self._reset,
            "step": lambda: self._step(request["action"]),
            "render": self._render,
        }
        answer = answers[request["cmd"]]()
        fault = FAULTS.get(self._name)
        if fault is not None and self._num_steps == FAULTY_STEP:
            fault(link)
        else:
            link.send(json.dumps(answer))

    def _reset(self) -> Any:
        self._position, self._num_steps, self._num_frames = 0.0, 0, 0
        return {"init_observation": [0.0, 0.0]}

    def _step(self, action: list[float]) -> Any:
        self._num_steps += 1
        self._position += action[0]
        observation = [self._position, float(self._num_steps)]
        return {"observation": observation, "reward": 0.5, "done": self._position > 3.0}

    def _render(self) -> Any:
        if self._name == "render_nowhere":
            return {"render_error": "0"}
        try:
            file = f"{self._render_path}{self._num_frames}.png"
            Image.new("RGB", (3, 2), (10, 20, self._num_frames)).save(file)
        except OSError:
            return {"render_error": "12"}
        self._num_frames += 1
        return {"render_error": "0"}


def say(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def _die(_link: ClientConnection) -> None:
    say("about to fall")
    os._exit(7)


def _freeze(_link: ClientConnection) -> None:
    time.sleep(600.0)


def _ping_for_ever(link: ClientConnection) -> None:
    while True:
        link.ping()
        time.sleep(0.02)


def _split_for_ever(link: ClientConnection) -> None:
    link.send(iter(lambda: "[", ""))


def _answer_twice(link: ClientConnection) -> None:
    for _ in range(2):
        link.send('{"observation": [1, 1], "reward": 0, "done": false}')


FAULTS: dict[str, Callable[[ClientConnection], None]] = {
    "die": _die,
    "freeze": _freeze,
    "ping": _ping_for_ever,
    "split": _split_for_ever,
    "twice": _answer_twice,
    "hang_up": lambda link: link.close(),
    "nonsense": lambda link: link.send("this is not JSON"),
    "list": lambda link: link.send("[1, 2]"),
    "binary": lambda link: link.send(b"{}"),
    "huge": lambda link: link.send("[" + "1," * HUGE + "1]"),
    "no_reward": lambda link: link.send('{"observation": [1, 1], "done": false}'),
    "number_done": lambda link: link.send('{"observation": [1, 1], "reward": 1, "done": 1}'),
    "nan": lambda link: link.send('{"observation": [1, nan], "reward": 1, "done": false}'),
    "inf": lambda link: link.send('{"observation": [1, 1], "reward": -inf, "done": false}'),
    "short": lambda link: link.send('{"observation": [1], "reward": 1, "done": false}'),
    "ragged": lambda link: link.send('{"observation": [1, [2]], "reward": 1, "done": false}'),
    "null": lambda link: link.send('{"observation": [1, null], "reward": 1, "done": false}'),
}


def replay(link: ClientConnection) -> None:
    """Answer what a real game answered, and quit loudly if it is asked something else."""
    for line in CONVERSATION.read_text().splitlines():
        request, answer = json.loads(line)
        came = link.recv(timeout=30.0)
        if json.loads(came) != json.loads(request):
            sys.exit(f"ERROR: expected {request}, came {came!r}")
        link.send(answer)
    if json.loads(link.recv(timeout=30.0)) != {"cmd": "close"}:
        sys.exit("ERROR: expected close")


def play(link: ClientConnection, walk: Walk) -> None:
    while (request := json.loads(link.recv())) != {"cmd": "close"}:
        walk.answer(link, request)


CROWD = 40
"""As many visitors say nothing, and stay."""


def bother(address: tuple[str, int]) -> None:
    """Connect as others would: a browser with a page, a port scanner."""
    for start in (
        b"GET / HTTP/1.1\r\nHost: x\r\n\r\n",
        b"\x00\xff" * 6000,
        b"GET / HTTP/1.1\r\nHost: x\r\nOrigin: http://page\r\nUpgrade: websocket\r\n"
        b"Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
        b"Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n",
        b"",
    ):
        with socket.create_connection(address, 10.0) as stranger:
            stranger.sendall(start)
            stranger.shutdown(socket.SHUT_WR)
            try:
                say(stranger.recv(64)[:12].decode())
            except ConnectionError:
                say("reset")


def await_server(address: tuple[str, int]) -> None:
    """Wait until somebody listens; the connection itself is dropped at once."""
    deadline = time.monotonic() + 30.0
    while time.monotonic() < deadline:
        try:
            socket.create_connection(address, 1.0).close()
            return
        except ConnectionRefusedError:
            time.sleep(0.05)


def main() -> None:
    name = sys.argv[1]
    given = dict(argument.split("=", 1) for argument in sys.argv if "=" in argument)
    address = given["--serverIP"], int(given["--serverPort"])
    if name == "exit":
        sys.exit("ERROR: no such scene")
    if name == "never":
        time.sleep(600.0)
    if name in {"bother", "only_bother"}:
        bother(address)
    if name == "crowd":
        crowd = [socket.create_connection(address, 10.0) for _ in range(CROWD)]
        say(f"{len(crowd)} are silent")
    if name == "only_bother":
        time.sleep(600.0)
    if name == "patient":
        await_server(address)
    say(f"playing {name}")
    with connect(f"ws://{address[0]}:{address[1]}", compression=None) as link:
        try:
            replay(link) if name == "replay" else play(link, Walk(name, given["--renderPath"]))
        except ConnectionClosed:
            say("GYMGODOT : Server connection lost, exit")


if __name__ == "__main__":
    main()
