"""A game in real Godot guides its training: whatever it asks for, and however it ends."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path
from typing import Any

import pytest
import torch

from ludus.model import read_model
from ludus.networks.tensors import as_tensor
from ludus.runs.checkpoint import Checkpoint
from ludus.runs.run_folder import RunFolder
from tests.serve.guided.conftest import Running
from tests.serve.guided.godot_game import DEADLINE_S, NUM_WORLDS, GodotGame, make_project
from tests.serve.guided.test_game_server import BUSY, Client
from tests.serve.guided.test_guidance import await_result

pytestmark = [pytest.mark.engine, pytest.mark.games]

Play = Callable[..., GodotGame]


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_project(tmp_path_factory.mktemp("guides") / "game")


@pytest.fixture
def play(project: Path, tmp_path: Path) -> Iterator[Play]:
    """Starts games, and ends them."""
    games: list[GodotGame] = []
    numbers = count()

    def start_one(port: int, of: Path = project) -> GodotGame:
        games.append(GodotGame(of, tmp_path / f"game-{next(numbers)}", port))
        return games[-1]

    yield start_one
    for game in games:
        game.close()


def newest(server: Running) -> Checkpoint:
    return server.newest("pennies")


def assert_equal(first: Checkpoint, second: Checkpoint) -> None:
    assert first.agent_steps == second.agent_steps
    for policy in ("even", "odd"):
        one, two = (checkpoint.learners[policy].tensors for checkpoint in (first, second))
        assert one.keys() == two.keys()
        assert [name for name in one if not torch.equal(one[name], two[name])] == []


def test_every_request_of_a_game_is_carried_out(server: Running, play: Play) -> None:
    game = play(server.port)
    trained = game.train()
    assert trained["policies"]["even"]["mean_return"] is not None
    folder = server.folder("pennies")
    assert folder.checkpoints().paths()

    game.ask("stop")
    stopped = game.await_state("standby")
    assert newest(server).agent_steps == stopped["agent_steps"]
    assert game.await_state("standby")["agent_steps"] == stopped["agent_steps"]

    before = newest(server)
    game.ask("play_round")
    game.await_state("playing")
    played = game.await_state("standby")
    assert {name: score["episodes"] for name, score in played["round"].items()} == {
        "even": NUM_WORLDS,
        "odd": NUM_WORLDS,
    }
    even, odd = (played["round"][name]["mean_return"] for name in ("even", "odd"))
    assert even == -odd
    game.ask("write_policies")
    written = game.await_status(lambda status: "written" in status)["written"]
    for policy in ("even", "odd"):
        weight = before.learners[policy].tensors["policy.actor.0.weight"]
        assert torch.equal(as_tensor(read_model(written[policy]).layers[0].weight), weight)

    game.ask("set_policy_mode odd FROZEN")
    game.await_status(lambda status: status["policies"]["odd"]["mode"] == "frozen")
    game.ask("start")
    game.await_updates(stopped["updates"] + 5)
    game.ask("play_round")
    game.await_state("playing")
    game.await_status(lambda status: status["state"] == "training" and "round" in status)
    game.ask("stop")
    last = game.await_state("standby")
    assert last["agent_steps"] > stopped["agent_steps"]
    after = newest(server)
    weights = "policy.actor.0.weight"
    pairs = {name: (before.learners[name].tensors[weights], after.learners[name].tensors[weights])
             for name in ("even", "odd")}  # fmt: skip
    assert torch.equal(*pairs["odd"])
    assert not torch.equal(*pairs["even"])
    kept = [int(path.name[7:]) for path in folder.checkpoints().folder.glob("update-*")]
    assert sorted(kept) == list(range(4, int(last["updates"]) + 1, 4))
    assert game.process.script_errors == []


def test_keys_of_the_project_choose_who_learns(server: Running, play: Play) -> None:
    game = play(server.port)
    game.train()
    chosen = {"8": "odd", "7": "even", "Kp_8": "odd", "Kp_7": "even",
              "9": "even odd", "0": "", "Kp_9": "even odd", "Kp_0": ""}  # fmt: skip
    for key, learning in chosen.items():
        game.ask(f"press {key}")
        expected = {
            name: "train" if name in learning.split() else "deterministic"
            for name in ("even", "odd")
        }
        game.await_status(lambda status, expected=expected: modes(status) == expected)
    assert game.process.script_errors == []


def modes(status: dict[str, Any]) -> dict[str, str]:
    """Return the mode of each policy."""
    return {name: of["mode"] for name, of in status["policies"].items()}


def test_a_killed_game_resumes_its_run(server: Running, play: Play, tmp_path: Path) -> None:
    game = play(server.port)
    seen = game.train()
    os.kill(game.process.pid, signal.SIGKILL)
    again = play(server.port)
    back = again.await_state("standby")
    assert back["agent_steps"] >= seen["agent_steps"]
    assert newest(server).agent_steps == back["agent_steps"]
    again.ask("start")
    assert again.await_updates(back["updates"] + 3)["agent_steps"] > back["agent_steps"]
    again.close()
    other = play(server.port, make_project(tmp_path / "other", 3))
    new = other.await_state("standby")
    assert new["agent_steps"] == 0
    assert "kept as pennies.old-1" in new["message"]
    old = RunFolder(server.config.runs / "pennies.old-1").checkpoints().newest()[1]
    assert old.agent_steps > back["agent_steps"]


def test_other_clients_and_a_game_error_do_not_lose_training(server: Running, play: Play) -> None:
    game = play(server.port)
    game.train()
    second = play(server.port)
    client, half = Client(server.port), Client(server.port)
    with client.socket, half.socket:
        half.send(b"\x40\x00\x00\x00\x01\x00")
        client.send(b"GET / HTTP/1.1\r\n\r\n")
        assert client.report()["code"] == "frame"
        assert BUSY["message"] in second.await_state("offline")["message"]
        seen = game.await_updates(0)["updates"]
        game.await_updates(seen + 5)
    game.ask("break")
    left = game.await_state("offline")
    assert re.search(r"reward.*world 2|world 2.*reward", left["message"]), left
    await_result(server.folder("pennies"))
    assert newest(server).run["updates"] >= seen
    game.ask("connect_trainer")
    assert game.await_state("standby")["updates"] >= seen


class Served:
    """``python -m ludus serve`` in a process of its own."""

    def __init__(self, folder: Path, *arguments: str) -> None:
        self.log = folder / "serve.log"
        command = [sys.executable, "-m", "ludus", "serve", "--port", "0", "--runs", str(folder)]
        with (folder / "stderr").open("wb") as output:
            self.process = subprocess.Popen(
                [*command, "--log", str(self.log), *arguments], stderr=output
            )
        self._output = folder / "stderr"

    def port(self) -> int:
        deadline = time.monotonic() + DEADLINE_S
        while time.monotonic() < deadline and self.process.poll() is None:
            found = re.search(r"serving ludus games in .*:(\d+)$", self.text(), re.MULTILINE)
            if found:
                return int(found[1])
            time.sleep(0.05)
        raise AssertionError(self.text())

    def text(self) -> str:
        return self._output.read_text()

    def end(self) -> None:
        self.process.kill()
        self.process.wait()


@pytest.mark.parametrize("signum", [None, signal.SIGTERM])
def test_the_command_ends_with_the_game_or_a_signal(
    signum: signal.Signals | None, play: Play, tmp_path: Path
) -> None:
    runs = tmp_path / "runs"
    runs.mkdir()
    served = Served(runs, "--once")
    try:
        game = play(served.port())
        seen = game.train()
        if signum is None:
            os.kill(game.process.pid, signal.SIGKILL)
            assert served.process.wait(DEADLINE_S) == 0
        else:
            served.process.send_signal(signum)
            game.await_state("offline")
            assert served.process.wait(DEADLINE_S) == 128 + signum
    finally:
        served.end()
    checkpoint = RunFolder(runs / "pennies").checkpoints().newest()[1]
    assert checkpoint.agent_steps >= seen["agent_steps"]
    assert "Traceback" not in served.text()
    assert "connected: godot 4" in served.log.read_text()
