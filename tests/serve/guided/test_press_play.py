"""Somebody presses Play, and nothing runs yet: the game starts the server, and guides it."""

from __future__ import annotations

import itertools
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest

from ludus.engine import (
    EngineProcess,
    GodotFlags,
    LaunchConfig,
    ensure_imported,
    find_engine,
    godot_command,
    read_project,
)
from ludus.runs.metrics import read_metrics
from ludus.runs.run_folder import RunFolder
from tests.serve.guided.godot_game import SCENE, make_project

pytestmark = [pytest.mark.engine, pytest.mark.games]

DEADLINE_S = 90.0
# The scene that is trained brings the node itself, and goes on being played without a trainer.
TRAINING = """\
[ext_resource type="Script" path="res://addons/ludus/training/ludus_training.gd" id="2"]
[ext_resource type="Script" path="res://life.gd" id="3"]
[node name="Training" type="Node" parent="."]
script = ExtResource("2")
run_name = "pressed"
num_worlds = 8
port = {port}
[node name="Life" type="Node" parent="."]
script = ExtResource("3")
"""
# Tells that the game lives, and what its people read; in the copies that are trained it is silent.
LIFE = """\
extends Node
func _ready() -> void:
	if not $"../Training".is_in_charge():
		queue_free()
func _process(_delta: float) -> void:
	if Engine.get_process_frames() % 20 == 0:
		print("alive: ", $"../Training".message)
"""

Press = Callable[[], EngineProcess]


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def await_that(is_there: Callable[[], bool], what: Callable[[], str]) -> None:
    deadline = time.monotonic() + DEADLINE_S
    while not is_there():
        assert time.monotonic() < deadline, what()
        time.sleep(0.05)


def servers(port: int) -> list[psutil.Process]:
    return [
        process
        for process in psutil.process_iter(["cmdline"])
        if {"serve", str(port)} <= set(process.info["cmdline"] or ())
    ]


class Desk:
    """A project that is open in the editor, so to say."""

    def __init__(self, folder: Path) -> None:
        self.port = free_port()
        self.project = make_project(folder)
        head, body = SCENE.split("[node", 1)
        extras, nodes = TRAINING.format(port=self.port).split("[node", 1)
        scene = f"{head}{extras}[node{body}[node{nodes}"
        (self.project / "pressed.tscn").write_text(scene)
        (self.project / "life.gd").write_text(LIFE)
        self.games: list[EngineProcess] = []

    @property
    def run(self) -> RunFolder:
        return RunFolder(self.project / "runs" / "pressed")

    def press_play(self) -> EngineProcess:
        project = read_project(self.project)
        engine = find_engine(project.engine_kind)
        ensure_imported(engine, project)
        flags = GodotFlags(fixed_fps=None)  # as the editor does: the game keeps time itself
        command = godot_command(engine, self.project, "res://pressed.tscn", flags)
        self.games.append(EngineProcess.start(LaunchConfig(command=command)))
        return self.games[-1]

    def await_steps(self, num: int) -> int:
        """Wait until a checkpoint has so many agent steps; returns those of the newest."""
        await_that(lambda: self.steps() >= num, lambda: f"{self.steps()} steps: {self.said()}")
        return self.steps()

    def steps(self) -> int:
        paths = self.run.checkpoints().paths()
        return int(paths[-1].name.removeprefix("step-")) if paths else -1

    def await_end_of_servers(self) -> None:
        await_that(lambda: not servers(self.port), self.said)

    def said(self) -> str:
        log = self.project / "runs" / "serve.log"
        server = log.read_text() if log.exists() else "no server"
        return "\n".join([server, *self.games[-1].last_lines(20)])


@pytest.fixture
def desk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Desk]:
    monkeypatch.setenv("LUDUS_PYTHON", sys.executable)
    desk = Desk(tmp_path / "game")
    yield desk
    for game in desk.games:
        game.terminate()
    for server in servers(desk.port):
        server.kill()


def test_a_game_that_is_killed_leaves_nothing_but_its_run(desk: Desk) -> None:
    game = desk.press_play()
    desk.await_steps(0)
    await_that(desk.run.metrics.exists, desk.said)
    time.sleep(2.0)
    assert len(servers(desk.port)) == 1
    os.kill(game.pid, signal.SIGKILL)
    desk.await_end_of_servers()
    steps = desk.steps()
    assert steps > 0, desk.said()
    desk.run.checkpoints().newest()
    assert (desk.project / "runs" / ".gdignore").exists()
    assert (desk.project / "runs" / ".gitignore").read_text() == "*\n"
    again = desk.press_play()
    time.sleep(2.0)
    desk.await_steps(steps)
    await_that(lambda: f"pressed goes on at {steps} steps" in desk.said(), desk.said)
    again.terminate()
    desk.await_end_of_servers()
    assert desk.steps() >= steps


def test_a_server_that_dies_leaves_the_game(desk: Desk) -> None:
    game = desk.press_play()
    desk.await_steps(0)
    await_that(lambda: "training, at 0" in desk.said(), desk.said)
    for server in servers(desk.port):
        server.kill()
    await_that(lambda: has_said(game, "alive: the trainer has gone"), desk.said)
    assert game.is_alive
    assert not servers(desk.port), "it is not started again unasked"


def test_without_a_python_the_game_says_so_and_goes_on(
    desk: Desk, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LUDUS_PYTHON", "/nowhere/python")
    game = desk.press_play()
    await_that(lambda: has_said(game, "alive: /nowhere/python has no Ludus"), desk.said)
    assert has_said(game, "pip install")
    assert game.is_alive


@pytest.mark.alone
def test_training_runs_faster_than_real_time(desk: Desk) -> None:
    desk.press_play()
    # 2 agents in each of 8 worlds, one decision a tick, 60 ticks a second of the game's own time:
    # no more could pass, and while the trainer learns there are none.
    await_that(lambda: best_steps_per_s(desk) / 16 > 1.1 * 60, desk.said)


def best_steps_per_s(desk: Desk) -> float:
    """Return the most agent steps per second that were made within a second or more."""
    rows = read_metrics(desk.run.metrics) if desk.run.metrics.exists() else []
    return max(
        (
            (end["agent_steps"] - start["agent_steps"]) / (end["wall_s"] - start["wall_s"])
            for start, end in itertools.combinations(rows, 2)
            if end["wall_s"] > start["wall_s"] + 1.0
        ),
        default=0.0,
    )


def has_said(game: EngineProcess, words: str) -> bool:
    return any(words in line for line in game.last_lines(200))


FIND_PYTHON = """\
extends SceneTree
func _init() -> void:
	var process := preload("res://addons/ludus/training/trainer_process.gd").new()
	print("found ", process.find_python())
	quit()
"""


def open_to_others(path: Path) -> None:
    path.chmod(0o757)


def open_to_a_group(path: Path) -> None:
    os.chown(path, -1, 12345)
    path.chmod(0o775)


def give_away(path: Path) -> None:
    os.chown(path, 12345, -1)


NEEDS_ROOT = pytest.mark.skipif(os.geteuid() != 0, reason="only root gives files away")


@pytest.mark.parametrize(
    "change",
    [
        None,
        open_to_others,
        pytest.param(open_to_a_group, marks=NEEDS_ROOT),
        pytest.param(give_away, marks=NEEDS_ROOT),
    ],
)
@pytest.mark.parametrize("folder", [".", ".venv", ".venv/bin"])
def test_an_environment_that_others_may_change_is_not_run(
    folder: str,
    change: Callable[[Path], None] | None,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for name in ("LUDUS_PYTHON", "VIRTUAL_ENV"):
        monkeypatch.delenv(name, raising=False)
    above = tmp_path / "above"
    (above / "games").mkdir(parents=True)
    project = make_project(above / "games" / "game")
    (project / "find.gd").write_text(FIND_PYTHON)
    python = above / ".venv" / "bin" / "python"
    python.parent.mkdir(parents=True)
    python.write_text(f"#!/bin/sh\ntouch {tmp_path}/ran\necho there\n")
    python.chmod(0o755)
    if change is not None:
        change(above / folder)
    engine = find_engine(read_project(project).engine_kind)
    command = [str(engine.path), "--headless", "--path", str(project), "--script", "res://find.gd"]
    said = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True).stdout
    assert (f"found {python}" in said) is (change is None), said
    assert (tmp_path / "ran").exists() is (change is None)
    assert (f"{python.parents[1]} is not used" in said) is (change is not None)
