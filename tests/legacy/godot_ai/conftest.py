"""A server in this process, and a client that speaks the wire as an unmodified game does."""

from __future__ import annotations

import json
import socket
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
import torch

from ludus.serve.godot_ai import server
from ludus.serve.godot_ai.serving import ServeConfig, serve

DEADLINE_S = 60.0
INIT: dict[str, Any] = {
    "command": "init", "file_name": "hero", "state_dim": 3, "action_dim": 2, "batchsize": 16,
    "hidden_size": 24, "num_actor_layers": 1, "num_critic_layers": 2, "replay_capacity": 500,
}  # fmt: skip
STATES = "AIServerCommFiles/batch_state.json"
REPLAYS = "AIServerCommFiles/batch_replays.json"


class Client:
    """Sends objects without frames; collects bytes until they parse."""

    def __init__(self, port: int, project: Path) -> None:
        self.project = project
        self.socket = socket.create_connection(("127.0.0.1", port), DEADLINE_S)

    def send(self, data: bytes) -> None:
        self.socket.sendall(data)

    def receive(self) -> dict[str, Any]:
        data = b""
        while piece := self.socket.recv(4096):
            data += piece
            try:
                return json.loads(data)
            except ValueError:
                continue
        raise EOFError(data)

    def ask(self, command: str, **values: Any) -> dict[str, Any]:
        self.send(json.dumps({"command": command, **values}).encode())
        return self.receive()

    def init(self, **changes: Any) -> dict[str, Any]:
        return self.ask(**{**INIT, **changes})

    def act(self, states: dict[str, Any], deterministic: dict[str, bool]) -> dict[str, Any]:
        """Ask for a batch of actions; returns answer and file in one."""
        (self.project / STATES).write_text(json.dumps(states))
        answer = self.ask("get_batch_actions", deterministic_map=deterministic, path=STATES)
        return {**answer, "actions": json.loads((self.project / answer["path"]).read_text())}

    def submit(self, replays: Any) -> dict[str, Any]:
        (self.project / REPLAYS).write_text(json.dumps({"replays": replays}))
        return self.ask("submit_batch_replay", path=REPLAYS)

    def train(self, steps: int, name: str = "hero", **changes: Any) -> dict[str, Any]:
        values = {"print_logs": False, "checkpoint_name": name, **changes}
        return self.ask("train", file_name=name, steps=steps, **values)

    def is_dropped(self) -> bool:
        """Wait until the server closes the connection."""
        try:
            return self.socket.recv(1) == b""
        except ConnectionError:
            return True

    def close(self) -> None:
        self.socket.close()


class Running:
    """A server that runs in a thread."""

    def __init__(self, config: ServeConfig) -> None:
        self.config = config
        self.project = config.project
        self.port = 0
        self.error: BaseException | None = None
        self._is_stopping = threading.Event()
        self._is_ready = threading.Event()
        self._clients: list[Client] = []
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()
        assert self._is_ready.wait(DEADLINE_S)
        if self.error is not None:
            self._thread.join()
            raise self.error

    def _serve(self) -> None:
        def on_ready(port: int) -> None:
            self.port = port
            self._is_ready.set()

        try:
            serve(self.config, self._is_stopping.is_set, on_ready)
        except BaseException as error:
            self.error = error
            self._is_ready.set()

    def client(self) -> Client:
        client = Client(self.port, self.project)
        self._clients.append(client)
        return client

    def stop(self) -> None:
        self._is_stopping.set()
        for client in self._clients:
            client.close()
        self._thread.join(DEADLINE_S)
        assert not self._thread.is_alive()
        if self.error is not None:
            raise self.error


Start = Callable[..., Running]


@pytest.fixture
def project(tmp_path: Path) -> Path:
    folder = tmp_path / "game"
    folder.mkdir()
    (folder / "project.godot").write_text("config_version=5\n")
    return folder


@pytest.fixture
def start(project: Path) -> Iterator[Start]:
    """Starts servers of the project, and ends them; each looks often whether it shall."""
    num_threads = torch.get_num_threads()
    started: list[Running] = []

    def begin(**changes: Any) -> Running:
        values: dict[str, Any] = {"project": project, "port": 0, "seed": 7}
        started.append(Running(ServeConfig(**{**values, **changes})))
        return started[-1]

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(server, "POLL_S", 0.01)
        yield begin
        for running in started:
            running.stop()
    torch.set_num_threads(num_threads)


@pytest.fixture
def client(start: Start) -> Client:
    """A client of a fresh server, with the agent hero."""
    client = start().client()
    assert client.init() == {"done": True}
    return client


def await_work(pid: int, cpu_s: float) -> None:
    """Wait until a process has computed for so long, however busy the machine is."""
    process = psutil.Process(pid)
    goal = sum(process.cpu_times()[:2]) + cpu_s
    deadline = time.monotonic() + DEADLINE_S
    while sum(process.cpu_times()[:2]) < goal:
        assert time.monotonic() < deadline, "nothing is computed"
        time.sleep(0.02)


def saved_steps(project: Path) -> int:
    """Return the gradient steps of the newest checkpoint."""
    states = [json.loads(path.read_text()) for path in project.rglob("state.json")]
    return max(state["run"]["gradient_steps"] for state in states)


def replays(count: int, name: str = "hero", seed: int = 0, **changes: Any) -> list[dict[str, Any]]:
    """Return transitions in which doing what the first two numbers say brings reward."""
    random = np.random.default_rng(seed)
    rows: list[dict[str, Any]] = []
    for _ in range(count):
        state, action = random.uniform(-1, 1, 3), random.uniform(-1, 1, 2)
        rows.append({
            "state": state.tolist(), "action": action.tolist(),
            "reward": float(-5.0 * np.abs(state[:2] - action).sum()),
            "state_": random.uniform(-1, 1, 3).tolist(), "done": int(random.random() < 0.5),
            "agent_name": name, **changes,
        })  # fmt: skip
    return rows
