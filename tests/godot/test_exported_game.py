"""Exported games of both Godots: they train, and they play without Python."""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import re
import shutil
import subprocess
import sys
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
from numpy.typing import NDArray

import ludus
from ludus.cli import main
from ludus.engine import (
    EngineKind,
    ExportTemplate,
    GodotFlags,
    executable_command,
    export_game,
)
from ludus.engine.bundled import bundled_root
from ludus.model import PolicyModel, write_model
from ludus.model.policy_model import Distribution, Linear
from ludus.runs.metrics import read_metrics
from ludus.runs.run_folder import RunFolder
from ludus.session import LaunchOptions, open_session
from ludus.spec import PolicySpec
from ludus.wire.handshake import EngineConfig
from tests.godot_project import export_project
from tests.serve.guided.test_press_play import free_port, servers
from tests.targets import find_game

pytestmark = [pytest.mark.engine, pytest.mark.games, pytest.mark.timeout(600)]

NUM_STEPS = 300
FULL_LENGTH = 250
TIMEOUT_S = 60.0


@pytest.fixture(scope="module", params=["godot4", "godot3"])
def kind(request: pytest.FixtureRequest) -> str:
    """Which Godot it is."""
    return request.param


@pytest.fixture(scope="module")
def cart(kind: str) -> PolicySpec:
    """What the agent of CartPole declares."""
    session = open_session(find_game(f"{kind}:cartpole"), EngineConfig(), LaunchOptions())
    with contextlib.closing(session):
        return session.policies["cart"]


def linear_policy(spec: PolicySpec, push_right: list[float]) -> PolicyModel:
    """Push right where the weighted sum of the observation is positive, left elsewhere."""
    weight = np.array([[0.0] * 4, push_right], np.float32)
    return PolicyModel(
        policy="cart",
        fingerprint=spec.fingerprint(),
        observation=spec.observation,
        action=spec.action,
        has_action_mask=False,
        normalisation=None,
        images=(),
        memory=None,
        layers=(Linear(weight, np.zeros(2, np.float32), "none"),),
        distribution=Distribution(np.zeros(0, np.float32)),
    )


POLICY = {
    "godot4": """\
[ext_resource type="Script" path="res://addons/ludus/policy/ludus_policy.gd" id="policy"]
[ext_resource type="JSON" path="res://balance.ludus.json" id="model"]

[sub_resource type="Resource" id="balance"]
script = ExtResource("policy")
model = ExtResource("model")

""",
    "godot3": """\
[ext_resource path="res://addons/ludus/ludus_policy.gd" type="Script" id=9]

[sub_resource type="Resource" id=9]
script = ExtResource( 9 )
model = "res://balance.ludus.json"

""",
}
AGENT = {
    "godot4": (
        '[node name="LudusAgent" type="Node" parent="."]\nscript = ExtResource("2")\n',
        'policy = SubResource("balance")\n',
    ),
    "godot3": (
        '[node name="LudusAgent" type="Node" parent="."]\nscript = ExtResource( 2 )\n',
        "policy = SubResource( 9 )\n",
    ),
}


TRAINING = """[gd_scene format=3]

[ext_resource type="Script" path="res://addons/ludus/training/ludus_training.gd" id="1"]

[node name="Training" type="Node"]
script = ExtResource("1")
run_name = "exported"
port = {port}
scene_path = "res://examples/cartpole/cartpole.tscn"
"""


@pytest.fixture(scope="module")
def project(kind: str, cart: PolicySpec, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The bundled project; it starts with a CartPole that a policy of its own balances."""
    folder = tmp_path_factory.mktemp("project") / "examples"
    ignored = shutil.ignore_patterns(".godot", ".import", "tests")
    shutil.copytree(bundled_root(EngineKind(kind)), folder, ignore=ignored)
    # Angle and angular velocity, both to the right of upright: the cart must follow.
    write_model(folder / "balance.ludus.json", linear_policy(cart, [0.0, 0.0, 1.0, 1.0]))
    scene = (folder / "examples/cartpole/cartpole.tscn").read_text()
    scene = replace_once(scene, "[sub_resource", POLICY[kind] + "[sub_resource")
    agent, policy = AGENT[kind]
    (folder / "balance.tscn").write_text(replace_once(scene, agent, agent + policy))
    set_main_scene(folder, "balance")
    return folder


def set_main_scene(folder: Path, name: str) -> None:
    settings = (folder / "project.godot").read_text()
    line = f'run/main_scene="res://{name}.tscn"'
    changed, count = re.subn(r"^run/main_scene=.*$", line, settings, flags=re.MULTILINE)
    assert count == 1
    (folder / "project.godot").write_text(changed)


def replace_once(text: str, old: str, new: str) -> str:
    assert old in text
    return text.replace(old, new, 1)


@pytest.fixture(scope="module")
def game(
    kind: str, project: Path, template: ExportTemplate, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """The exported game; nothing of the project is left beside it."""
    output = tmp_path_factory.mktemp("exported") / "game.x86_64"
    return export_project(kind, project, output)


def record(target: str) -> NDArray[np.float32]:
    """Play at random; return observations, rewards and ends, ``[steps, worlds, 7]``."""
    envs: Any = ludus.make_vec(target, num_worlds=4)
    rows: list[NDArray[np.float32]] = []
    try:
        envs.reset(seed=3)
        envs.action_space.seed(5)
        for _ in range(NUM_STEPS):
            observation, *outcome, _ = envs.step(envs.action_space.sample())
            rows.append(np.column_stack([observation, *outcome]).astype(np.float32))
    finally:
        envs.close()
    return np.stack(rows)


def test_exported_game_is_the_environment_that_the_project_is(kind: str, game: Path) -> None:
    exported, from_editor = record(str(game)), record(f"{kind}:cartpole")
    assert exported.shape == (NUM_STEPS, 4, 7)
    assert exported[:, :, 5].sum() > 4  # episodes have ended
    np.testing.assert_array_equal(exported, from_editor)


def test_exported_game_can_be_measured(game: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options = ["--worlds", "4", "--rounds", "1", "--seconds", "0.2", "--json"]
    assert main(["bench", str(game), *options]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["num_worlds"] == 4
    assert report["agent_steps_per_s"] > 0


@dataclass(frozen=True)
class Played:
    """What a game that was started alone has told, and what it used."""

    episodes: list[dict[str, Any]]
    num_children: int
    num_connections: int


def play_alone(game: Path, home: Path, num_episodes: int, *options: str) -> Played:
    """Start a game as a player would, outside of any project and environment."""
    command = executable_command(game, GodotFlags(user_args=("--ludus-report", *options)))
    with subprocess.Popen(
        command,
        cwd=home,
        env={"HOME": str(home), "PATH": os.environ["PATH"]},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        watchdog = threading.Timer(TIMEOUT_S, process.kill)
        watchdog.start()
        try:
            assert process.stderr is not None
            reports = (line for line in process.stderr if line.startswith("ludus-episode "))
            lines = list(itertools.islice(reports, num_episodes))
            assert len(lines) == num_episodes, "the game ended, or took too long"
            running = game_process(psutil.Process(process.pid), game)
            children, connections = running.children(), running.net_connections("all")
        finally:
            watchdog.cancel()
            for each in [*psutil.Process(process.pid).children(recursive=True), process]:
                each.kill()
    episodes = [json.loads(line.removeprefix("ludus-episode ")) for line in lines]
    return Played(episodes, len(children), len(connections))


def game_process(started: psutil.Process, game: Path) -> psutil.Process:
    """Find the game among what was started: Godot 3 may need a virtual screen, which starts it."""
    pack = str(game.with_suffix(".pck"))
    inner = (each for each in started.children(recursive=True) if pack in each.cmdline())
    return next(inner, started)


def test_exported_game_plays_its_policy_without_python(game: Path, tmp_path: Path) -> None:
    played = play_alone(game, tmp_path, num_episodes=5)
    report = {"policy": "cart", "return": FULL_LENGTH, "length": FULL_LENGTH}
    assert played.episodes == [report] * 5
    assert (played.num_children, played.num_connections) == (0, 0)


def test_exported_game_plays_the_policy_of_the_command_line(
    game: Path, cart: PolicySpec, tmp_path: Path
) -> None:
    # The wrong way round: whatever leans is pushed over.
    write_model(tmp_path / "worst.ludus.json", linear_policy(cart, [0.0, 0.0, -1.0, -1.0]))
    option = f"--ludus-policy=cart={tmp_path / 'worst.ludus.json'}"
    episodes = play_alone(game, tmp_path, 5, option).episodes
    assert all(0 < episode["length"] < FULL_LENGTH / 2 for episode in episodes)


@pytest.mark.parametrize("kind", ["godot4"], indirect=True)
def test_exported_game_guides_its_training(
    project: Path, template: ExportTemplate, tmp_path: Path
) -> None:
    folder, port = tmp_path / "project", free_port()
    shutil.copytree(project, folder)
    (folder / "training.tscn").write_text(TRAINING.format(port=port))
    set_main_scene(folder, "training")
    game = export_game(folder, tmp_path / "exported" / "game.x86_64")
    shutil.rmtree(folder)
    environment = {"HOME": str(tmp_path), "LUDUS_PYTHON": sys.executable}
    command = [str(game), "--headless"]
    run = RunFolder(tmp_path / ".local/share/godot/app_userdata/Ludus/runs/exported")
    deadline = time.monotonic() + TIMEOUT_S
    with subprocess.Popen(command, cwd=tmp_path, env=environment) as process:
        try:
            while not num_updates(run):
                assert process.poll() is None
                assert time.monotonic() < deadline, list(tmp_path.rglob("*"))
                time.sleep(0.1)
        finally:
            process.kill()
    while servers(port):
        assert time.monotonic() < deadline, "the server outlives the game"
        time.sleep(0.1)
    assert run.checkpoints().newest()[1].agent_steps > 0


def num_updates(run: RunFolder) -> int:
    return len(read_metrics(run.metrics)) if run.metrics.exists() else 0
