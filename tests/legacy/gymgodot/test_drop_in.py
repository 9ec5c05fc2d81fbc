"""Environments that were written for GymGodot, on our protocol, in a real Godot 3."""

from __future__ import annotations

import json
import re
import shlex
import shutil
import subprocess
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import ludus
from ludus.cli.main import main
from ludus.engine import EngineKind, find_engine
from ludus.errors import EngineCrashed, GameError, TargetError
from ludus.legacy.addon import install_legacy_addon

pytestmark = pytest.mark.engine

PROJECT = Path(__file__).with_name("project")
NODE = re.compile(r"^environmentNode = .*$", re.MULTILINE)
FIVE_STEPS = [
    [0.0, 0.0, 0.0, 0.0],
    [-0.088461, -0.088461, 0.010975, 0.010975],
    [-0.294491, -0.206029, 0.036528, 0.025553],
    [-0.617754, -0.323263, 0.076685, 0.040157],
    [-1.057811, -0.440057, 0.131532, 0.054847],
]
"""GymGodot's own cart-pole, pushed left five times, under Godot 3.6.2."""


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The games, with the add-on in the place of GymGodot, and with what an action is."""
    find_engine(EngineKind.GODOT3)
    folder = tmp_path_factory.mktemp("drop_in") / "project"
    shutil.copytree(PROJECT, folder)
    install_legacy_addon(folder)
    write_scene(folder, "cartpole", "cartpole", "discrete_n = 2")
    write_scene(folder, "walk", "walk", "continuous_size = 1\ndebugPrint = true")
    write_scene(folder, "leaning", "cartpole", "discrete_n = 2\nmax_episode_steps = 250")
    scene = folder / "leaning.tscn"
    start = "script = ExtResource( 2 )\n"
    scene.write_text(scene.read_text().replace(start, f"{start}start_lean = 0.05\n"))
    return folder


def write_scene(folder: Path, name: str, source: str, properties: str) -> None:
    text = (PROJECT / f"{source}.tscn").read_text()
    (folder / f"{name}.tscn").write_text(NODE.sub(lambda line: f"{line[0]}\n{properties}", text))


@pytest.mark.parametrize("num_worlds", [1, 5])
def test_the_five_steps_of_the_notebook(project: Path, num_worlds: int) -> None:
    envs = ludus.make_vec(project / "cartpole.tscn", num_worlds=num_worlds)
    try:
        for _ in range(2):
            first, _ = envs.reset(seed=0)
            assert not first.any()
            for expected in FIVE_STEPS:
                observation, reward, terminated, _, _ = envs.step(np.zeros(num_worlds, np.int64))
                assert observation == pytest.approx(np.array([expected] * num_worlds), abs=1e-6)
                assert reward.tolist() == [1.0] * num_worlds
                assert not terminated.any()
    finally:
        envs.close()


@pytest.mark.parametrize("scene", ["cartpole", "as_it_was"])
def test_the_same_project_serves_gymgodots_python(project: Path, scene: str) -> None:
    write_scene(project, "as_it_was", "cartpole", "")
    program = find_engine(EngineKind.GODOT3).executable(headless=True)
    env = gymnasium.make(
        "server-v0",
        serverPort="0",
        exeCmd=shlex.join(["cd", str(project)]) + f" && {shlex.quote(str(program))} {scene}.tscn",
        action_space=gymnasium.spaces.Discrete(2),
        observation_space=gymnasium.spaces.Box(-np.inf, np.inf, (4,)),
    )
    try:
        for _ in range(2):
            first, _ = env.reset()
            assert not first.any()
            for expected in FIVE_STEPS:
                observation, reward, terminated, *_ = env.step(0)
                assert observation == pytest.approx(np.array(expected), abs=1e-6)
                assert (reward, terminated) == (1.0, False)
    finally:
        env.close()


def test_the_same_scene_serves_the_wire_of_gymgodot(project: Path) -> None:
    settings: dict[str, Any] = {
        "action_space": "Box(-1, 1, (1,))",
        "observation_space": "Box(-inf, inf, (3,))",
    }
    with ludus.make(f"gymgodot:{project / 'walk.tscn'}", **settings) as env:
        env.reset()
        for count in range(1, 7):
            observation, reward, terminated, *_ = env.step(np.array([0.25], np.float32))
            assert observation.tolist() == [0.5 * count, 2 * count, 2 * count]
            assert (reward, terminated) == (0.25 * count, False)
        assert env.step(np.array([0.25], np.float32))[2]


def test_a_lost_environment_node_ends_the_game(project: Path) -> None:
    text = (PROJECT / "walk.tscn").read_text()
    (project / "lost.tscn").write_text(NODE.sub('environmentNode = NodePath("../Nobody")', text))
    settings: dict[str, Any] = {"action_space": "Discrete(2)", "observation_space": "Discrete(2)"}
    with pytest.raises(EngineCrashed, match=r"'\.\./Nobody' leads nowhere"):
        ludus.make(f"gymgodot:{project / 'lost.tscn'}", **settings)


def test_every_frame_of_a_step_gets_the_action(project: Path) -> None:
    envs = ludus.make_vec(project / "walk.tscn", num_worlds=2)
    try:
        envs.reset(seed=0)
        action = np.array([[0.25], [-0.25]], np.float32)
        for count in range(1, 7):
            place = 0.5 * count
            observation, reward, *_ = envs.step(action)
            counts = [2 * count, 2 * count]
            assert observation.tolist() == [[place, *counts], [-place, *counts]]
            assert reward.tolist() == [place / 2, -place / 2]
        _, _, terminated, _, infos = envs.step(action)
        assert terminated.tolist() == [True, False]
        assert infos["final_obs"][0].tolist() == [3.5, 14, 14]
    finally:
        envs.close()


def test_ludus_check_passes(project: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", str(project / "leaning.tscn"), "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    wrong = [finding for finding in report["findings"] if finding["status"] in {"warn", "fail"}]
    assert wrong == []


def test_a_scene_that_does_not_say_what_an_action_is(project: Path) -> None:
    write_scene(project, "silent", "cartpole", "")
    with pytest.raises(TargetError, match="set discrete_n or continuous_size"):
        ludus.make(project / "silent.tscn")


@pytest.mark.parametrize(
    ("properties", "what"),
    [
        ("", r"environmentNode '' leads nowhere"),
        ('environmentNode = NodePath("../Nobody")', r"'\.\./Nobody' leads nowhere"),
        ('environmentNode = NodePath("..")', r"has no method apply_action\(\)"),
    ],
)
def test_missing_environment_node_is_reported(project: Path, properties: str, what: str) -> None:
    text = (PROJECT / "walk.tscn").read_text()
    (project / "lost.tscn").write_text(NODE.sub(f"discrete_n = 2\n{properties}", text))
    with pytest.raises(TargetError, match=what):
        ludus.make(project / "lost.tscn")


def test_switched_off_the_scene_runs_on_its_own(project: Path) -> None:
    write_scene(project, "off", "walk", "enabled = false")
    engine = find_engine(EngineKind.GODOT3)
    done = subprocess.run(
        [engine.path, "--path", project, "off.tscn", "--quit"],
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 0
    assert "SCRIPT ERROR" not in done.stderr
    assert "GYMGODOT" not in done.stdout


def test_a_wrong_number_is_named(project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WALK_FAULT", "nan")
    env = ludus.make(project / "walk.tscn")
    try:
        env.reset(seed=0)
        with pytest.raises(GameError, match="GodotGym"):
            for _ in range(5):
                env.step(np.array([0.25], np.float32))
    finally:
        env.close()
