"""What docs/godot_gym_api.md tells its readers to write works as it stands there."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any, cast

import pytest

from tests.legacy.gymgodot.conftest import ROOT, left_processes
from tests.legacy.install.originals import add_originals

pytestmark = pytest.mark.engine

PAGE = (ROOT / "docs/godot_gym_api.md").read_text()
SCENE = """\
[gd_scene load_steps=4 format=2]

[ext_resource path="res://environment.gd" type="Script" id=1]
[ext_resource path="res://agent.gd" type="Script" id=2]
[ext_resource path="res://world.gd" type="Script" id=3]

[node name="Environment" type="Spatial"]
script = ExtResource( 1 )

[node name="Agent" type="Spatial" parent="."]
script = ExtResource( 2 )

[node name="World" type="Spatial" parent="."]
script = ExtResource( 3 )
"""
PROJECT = """\
config_version=4

[application]

config/name="From the page"
run/main_scene="res://environment.tscn"
"""
SHORT = "512, evaluation_episodes=2"


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)


@pytest.fixture(scope="module")
def game(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The game of the page, in a project that had the original's scripts."""
    folder = tmp_path_factory.mktemp("page")
    for script in blocks("gdscript"):
        name, text = script.split("\n", 1)
        (folder / name.removeprefix("# ")).write_text(text)
    (folder / "environment.tscn").write_text(SCENE)
    (folder / "project.godot").write_text(PROJECT)
    add_originals(folder)
    (command,) = re.findall(r"^ludus (addon install.*)$", PAGE, re.MULTILINE)
    arguments = cast(str, command).replace("path/to/game", str(folder)).split()
    subprocess.run([sys.executable, "-m", "ludus", *arguments], timeout=60, check=True)
    assert (folder / "godot_gym_api.old").is_dir()
    return folder


def test_the_environment(game: Path) -> None:
    code = blocks("python")[0].replace("path/to/game", str(game))
    names: dict[str, Any] = {}
    exec(code, names)
    # 4 frames of 1/60 s at a speed of 2 × 0.5 for each step: beyond 3 in step 46.
    assert names["terminated"]
    assert names["observation"]["place"] == pytest.approx(46 * 4 / 60.0, abs=1e-3)
    assert names["observation"]["distances"] == pytest.approx([0.0667, 6.0667], abs=1e-3)
    assert names["reward"] == 1.0
    assert left_processes() == []


def test_many_games_and_the_trainer(
    game: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    for code in blocks("python")[:3]:
        exec(code.replace("path/to/game", str(game)).replace("10_000", SHORT), names)
    assert names["observations"]["place"].shape == (2, 1)
    assert len(list((tmp_path / "runs").iterdir())) == 1
    assert left_processes() == []


def test_the_client(game: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code = blocks("python")[3].replace("path/to/game", str(game))
    exec(code, {})
    assert float(capsys.readouterr().out) == pytest.approx(2 / 60.0, abs=1e-4)
    assert left_processes() == []


@pytest.mark.slow
def test_it_can_be_trained(game: Path, tmp_path: Path) -> None:
    functions = "def get_reward" + blocks("python")[0].split("def get_reward")[1]
    (tmp_path / "my_rules.py").write_text(functions.split("env = ")[0])
    (typed,) = re.findall(
        r"^ludus (train godot_gym_api:.*)$", PAGE.replace("\\\n", ""), re.MULTILINE
    )
    arguments = shlex.split(cast(str, typed).replace("path/to/game", str(game)))
    sizes = ["--ppo.rollout-steps", "64", "--evaluation-episodes", "2"]
    arguments = [*arguments[:-1], "256", *sizes, "--runs", str(tmp_path / "runs")]
    done = subprocess.run(
        [str(Path(sys.executable).with_name("ludus")), *arguments],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=150,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert list((tmp_path / "runs").iterdir())
    assert left_processes() == []
