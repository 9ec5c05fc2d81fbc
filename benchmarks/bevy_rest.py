"""Steps a second over REST: `python benchmarks/bevy_rest.py PEER_EXECUTABLE`.

Plays cart-pole in turns with `rest_cartpole` of this repository in lock-step, and with a program
of the same task that is made with bevy_rl itself and runs as fast as it can. That program publishes
`{"agents": [[place, speed, lean, speed of the lean], …]}`, takes the actions "0" and "1", has as
many agents as the environment variable PEER_AGENTS says, and listens at 127.0.0.1:7878.

Three clients: `requests` without keep-alive, as the wrappers of bevy_rl's users have it; Python's
own with keep-alive; and Ludus. All ask for state and rewards of every step. The first one needs the
package `requests`.
"""

from __future__ import annotations

import json
import os
import socket
import statistics
import subprocess
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass
from http.client import HTTPConnection
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any
from urllib.parse import quote

import numpy as np
import tyro

from ludus.engine.bevy_build import build_bevy_example
from ludus.legacy.bevy_rl.game import Client
from ludus.legacy.bevy_rl.http import HttpConversation

PEER_ADDRESS = ("127.0.0.1", 7878)
START_TIMEOUT_S = 20.0
TIMEOUT_S = 30.0

Step = Callable[[list[str]], Any]


@dataclass(frozen=True)
class Settings:
    """What to measure."""

    peer: Annotated[Path, tyro.conf.Positional]
    """Executable made with bevy_rl."""
    agents: int = 1
    """Agents of the game, all in one request."""
    rounds: int = 5
    """Of each measurement, in turns; medians are printed."""
    seconds: float = 1.0
    """Length of a measurement."""


def main(settings: Settings) -> None:
    """Measure both programs with every client, and print steps a second."""
    ours = build_bevy_example("rest_cartpole")
    rates: dict[tuple[str, str], list[float]] = {}
    for _ in range(settings.rounds):
        for program, command in (("bevy_rl", [settings.peer]), ("ludus", [ours, "--port=7878"])):
            for client, connect in CLIENTS.items():
                with _running([*command, *_own_arguments(program, settings)], settings.agents):
                    rate = _measure(connect, settings)
                rates.setdefault((program, client), []).append(rate)
    _report(rates)


def _own_arguments(program: str, settings: Settings) -> list[str]:
    return [f"--agents={settings.agents}"] if program == "ludus" else []


@contextmanager
def _running(command: list[Any], num_agents: int) -> Generator[None]:
    environment = {**os.environ, "PEER_AGENTS": str(num_agents)}
    process = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL)
    try:
        _wait_for_listener()
        yield
    finally:
        process.kill()
        process.wait(TIMEOUT_S)


def _wait_for_listener() -> None:
    deadline = time.monotonic() + START_TIMEOUT_S
    while True:
        try:
            socket.create_connection(PEER_ADDRESS, TIMEOUT_S).close()
        except OSError:
            if time.monotonic() > deadline:
                raise
            time.sleep(0.05)
        else:
            return


def _measure(connect: Callable[[int], Step], settings: Settings) -> float:
    """Return steps a second of random play."""
    step = connect(settings.agents)
    generator = np.random.default_rng(7)
    choices = generator.integers(0, 2, (64, settings.agents)).astype("U1").tolist()
    for actions in choices:
        step(actions)
    num_steps, began = 0, time.perf_counter()
    while (passed := time.perf_counter() - began) < settings.seconds:
        step(choices[num_steps % len(choices)])
        num_steps += 1
    return num_steps / passed


def _payload(actions: list[str]) -> str:
    return json.dumps([{"action": action} for action in actions])


def _with_requests(_num_agents: int) -> Step:
    requests: Any = import_module("requests")
    root = "http://{}:{}".format(*PEER_ADDRESS)
    requests.get(f"{root}/reset", timeout=TIMEOUT_S).json()

    def step(actions: list[str]) -> Any:
        params = {"payload": _payload(actions)}
        agents = requests.get(f"{root}/step", params=params, timeout=TIMEOUT_S).json()
        return agents, requests.get(f"{root}/state", timeout=TIMEOUT_S).json()

    return step


def _with_keep_alive(_num_agents: int) -> Step:
    connection = HTTPConnection(*PEER_ADDRESS, timeout=TIMEOUT_S)

    def get(path: str) -> Any:
        connection.request("GET", path)
        return json.loads(connection.getresponse().read())

    get("/reset")
    return lambda actions: (get(f"/step?payload={quote(_payload(actions))}"), get("/state"))


def _with_ludus(_num_agents: int) -> Step:
    client = Client(HttpConversation(PEER_ADDRESS, START_TIMEOUT_S, TIMEOUT_S), with_pixels=False)
    client.reset()

    def step(actions: list[str]) -> Any:
        client.send_step(actions)
        return client.receive_step()

    return step


CLIENTS: dict[str, Callable[[int], Step]] = {
    "requests": _with_requests,
    "http.client": _with_keep_alive,
    "ludus": _with_ludus,
}


def _report(rates: dict[tuple[str, str], list[float]]) -> None:
    medians = {key: statistics.median(found) for key, found in rates.items()}
    slowest = medians["bevy_rl", "requests"]
    print("| client | bevy_rl, steps/s | ludus, steps/s | ratio | to bevy_rl with requests |")
    print("|---|---|---|---|---|")
    for client in CLIENTS:
        peer, own = medians["bevy_rl", client], medians["ludus", client]
        print(f"| {client} | {peer:,.0f} | {own:,.0f} | {own / peer:.1f} | {own / slowest:.1f} |")


if __name__ == "__main__":
    main(tyro.cli(Settings, description=__doc__))
