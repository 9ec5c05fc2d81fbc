"""The game's side of the wire as a small program, for tests without an engine.

``python -m tests.legacy.gdrl.fake_game NAME --port=…`` connects and plays. The name chooses what
it does: ``walk`` is right, ``old`` is right as plug-ins before 0.6 were, ``connect_again`` is right
and tries to connect a second time; everything else goes wrong before it has connected, in what it
says of itself, or in its third step.
"""

from __future__ import annotations

import contextlib
import json
import os
import socket
import sys
import time
from collections.abc import Callable
from typing import Any

FAULTY_STEP = 3
OBS = {"obs": {"size": [2], "space": "box"}}
ACT = {"move": {"size": 1, "action_type": "continuous"}}
INFO: dict[str, Any] = {
    "type": "env_info",
    "n_agents": 2,
    "observation_space": [OBS, OBS],
    "action_space": [ACT, ACT],
    "agent_policy_names": ["one", "one"],
}
OLD = {"type": "env_info", "n_agents": 2, "observation_space": OBS, "action_space": ACT}


def _size(size: Any) -> dict[str, Any]:
    return {"observation_space": {"obs": {"size": size, "space": "box"}}}


INTRODUCTIONS: dict[str, Any] = {
    "old": OLD,
    "nobody": {**INFO, "n_agents": 0},
    "too_few": {**INFO, "n_agents": 3},
    "no_spaces": {"type": "env_info", "n_agents": 2},
    "differ": {**INFO, "action_space": [ACT, {"move": {"size": 3, "action_type": "continuous"}}]},
    "sees_nothing": {**OLD, "observation_space": {}},
    "does_nothing": {**OLD, "action_space": {}},
    "strange_kind": {**OLD, "action_space": {"move": {"size": 1, "action_type": "telepathy"}}},
    "strange_size": {**OLD, **_size([2, "many"])},
    "huge_size": {**OLD, **_size([1 << 20, 1 << 20])},
    "nameless": {**INFO, "agent_policy_names": ["one", 2]},
}
OBSERVATIONS = [{"obs": [0.0, 0.0]}] * 2
STEP: dict[str, Any] = {
    "type": "step",
    "obs": OBSERVATIONS,
    "reward": [0.5, 1],
    "done": [False, False],
}
ANSWERS: dict[str, Any] = {
    "other_type": {"type": "reset", "obs": OBSERVATIONS},
    "one_agent": {**STEP, "obs": OBSERVATIONS[:1]},
    "no_entry": {**STEP, "obs": [{"obs": [0, 0]}, {"other": [0, 0]}]},
    "short": {**STEP, "obs": [{"obs": [0, 0]}, {"obs": [0]}]},
    "null": {**STEP, "obs": [{"obs": [0, 0]}, {"obs": [0, None]}]},
    "null_reward": {**STEP, "reward": [0, None]},
    "number_done": {**STEP, "done": [0, 1]},
}
RAW: dict[str, bytes] = {
    "nonsense": b"this is not JSON",
    "list": b"[1]",
    "deep": b"[" * 100_000,
    "nan": json.dumps({**STEP, "obs": [{"obs": [0, 0]}, {"obs": [0, float("nan")]}]}).encode(),
}


def die(_link: socket.socket) -> None:
    sys.stdout.write("about to fall\n")
    sys.stdout.flush()
    os._exit(7)


def connect_again(link: socket.socket) -> None:
    with contextlib.suppress(ConnectionRefusedError):
        socket.create_connection(link.getpeername(), 10.0).close()
        sys.exit("a second game could connect")
    link.sendall(frame(STEP))


FAULTS: dict[str, Callable[[socket.socket], None]] = {
    "connect_again": connect_again,
    "die": die,
    "freeze": lambda link: time.sleep(600.0),
    "hang_up": lambda link: link.close(),
    "half": lambda link: link.sendall(frame(STEP)[:-3]),
    "huge": lambda link: link.sendall(b"\xff\xff\xff\xff" + b"x" * 100),
    "twice": lambda link: link.sendall(frame(STEP) * 2),
}


def frame(message: Any) -> bytes:
    data = message if isinstance(message, bytes) else json.dumps(message).encode()
    return len(data).to_bytes(4, "little") + data


def hear(link: socket.socket) -> Any:
    def exactly(count: int) -> bytes:
        data = b""
        while len(data) < count:
            more = link.recv(count - len(data))
            if not more:
                sys.exit(0)
            data += more
        return data

    return json.loads(exactly(int.from_bytes(exactly(4), "little")))


def play(link: socket.socket, name: str) -> None:
    num_steps = -1  # a reset takes one step
    while (request := hear(link))["type"] != "close":
        if request["type"] == "reset":
            link.sendall(frame({"type": "reset", "obs": OBSERVATIONS, "info": [{}, {}]}))
        elif request["type"] == "call":
            link.sendall(frame({"type": "call", "returns": [{"obs": [0, 0]}] * 2}))
        else:
            num_steps += 1
            if num_steps != FAULTY_STEP:
                link.sendall(frame(STEP))
            elif name in FAULTS:
                FAULTS[name](link)
            else:
                link.sendall(frame(ANSWERS.get(name, RAW.get(name, STEP))))


def bother(address: tuple[str, int]) -> None:
    """Connect as others would: a browser, a port scanner, one that stays and says nothing."""
    for start in (b"GET / HTTP/1.1\r\nHost: x\r\n\r\n", b"\x00\xff" * 600, frame(b"{}"), b""):
        with socket.create_connection(address, 10.0) as stranger:
            stranger.sendall(start)
    globals()["silent"] = socket.create_connection(address, 10.0)


def main() -> None:
    name = sys.argv[1]
    given = dict(argument.split("=", 1) for argument in sys.argv if "=" in argument)
    address = "127.0.0.1", int(given["--port"])
    if name == "exit":
        sys.exit("ERROR: no such scene")
    if name == "never":
        time.sleep(600.0)
    if name in {"bother", "only_bother"}:
        bother(address)
    if name == "only_bother":
        time.sleep(600.0)
    with socket.create_connection(address, 10.0) as link:
        assert hear(link)["type"] == "handshake"
        assert hear(link)["type"] == "env_info"
        introduction = frame(INTRODUCTIONS.get(name, INFO))
        if name == "half_introduction":
            link.sendall(introduction[:-3])
            time.sleep(600.0)
        for byte in introduction:
            link.sendall(bytes([byte]))
        play(link, name)


if __name__ == "__main__":
    main()
