"""``ludus new`` and script templates: what it makes passes the check and trains, in real Godot."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

import ludus
from ludus.check import CheckConfig, Status, run_checks
from ludus.cli.main import main
from ludus.engine import EngineKind, find_engine
from ludus.settings.train_config import PPOConfig, TrainConfig

KINDS = ("2d", "3d", "simulation")


@pytest.mark.engine
@pytest.mark.parametrize("kind", KINDS)
def test_a_new_project_passes_the_check_and_trains(
    kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    game = tmp_path / "my-game"
    assert main(["new", str(game), f"--{kind}"]) == 0
    assert f"ludus train {game}" in capsys.readouterr().out
    assert 'config/name="my-game"' in (game / "project.godot").read_text()
    report = run_checks(CheckConfig(target=game, num_steps=210, num_layout_worlds=4, timing_s=0.1))
    bad = {Status.FAIL, Status.WARN}
    wrong = [finding for _, finding in report.findings if finding.status in bad]
    if kind == "3d":  # the floor is flat: nothing is above or below
        assert [finding.data["elements"] for finding in wrong] == [[1, 4, 7]], wrong
    else:
        assert not wrong, wrong
    config = TrainConfig(
        target=str(game), num_worlds=2, num_engines=1, total_steps=64, runs=tmp_path / "runs",
        evaluation_episodes=2, ppo=PPOConfig(rollout_steps=8, hidden_sizes=(8,)),
    )  # fmt: skip
    run = ludus.train(config, progress=False)
    assert len(run.evaluation) == 1


@pytest.mark.engine
@pytest.mark.parametrize("kind", KINDS)
def test_a_new_project_opens_in_the_editor(kind: str, tmp_path: Path) -> None:
    game = tmp_path / "game"
    assert main(["new", str(game), f"--{kind}"]) == 0
    godot = str(find_engine(EngineKind.GODOT4).executable(headless=True))
    command = [godot, "--headless", "--editor", "--quit", "--path", str(game)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert "ERROR" not in done.stdout + done.stderr, done.stdout + done.stderr


def test_nothing_is_overwritten(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "kept.txt").write_text("mine")
    assert main(["new", str(tmp_path)]) == 2
    assert "exists already" in capsys.readouterr().err
    assert [file.name for file in tmp_path.iterdir()] == ["kept.txt"]
    assert main(["new", str(tmp_path / "x"), "--2d", "--3d"]) == 2
    assert main(["new", str(tmp_path / 'a"b')]) == 2


def test_script_templates_are_installed_and_keep_what_is_there(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "project.godot").write_text("config_version=5\n")
    own = tmp_path / "script_templates" / "Node" / "ludus_agent.gd"
    own.parent.mkdir(parents=True)
    own.write_text("# mine\n")
    assert main(["addon", "install", str(tmp_path)]) == 0
    told = capsys.readouterr().out
    assert "new: script_templates/Node2D/ludus_sensor_2d.gd" in told
    assert own.read_text() == "# mine\n"
    assert (tmp_path / "script_templates" / ".gdignore").exists()
    assert main(["addon", "install", str(tmp_path)]) == 0
    assert "new:" not in capsys.readouterr().out.replace(" 0 new", "")


@pytest.mark.engine
def test_scripts_made_of_the_templates_are_valid(tmp_path: Path) -> None:
    game = tmp_path / "game"
    assert main(["new", str(game)]) == 0
    templates = game / "script_templates"
    godot = str(find_engine(EngineKind.GODOT4).executable(headless=True))
    for template in templates.rglob("*.gd"):
        script = game / template.name
        script.write_text(template.read_text().replace("_BASE_", "Node2D"))
        command = [godot, "--headless", "--path", str(game), "--check-only", "--script"]
        if not (game / ".godot").exists():
            subprocess.run([*command[:4], "--import"], check=True, timeout=120)
        done = subprocess.run(
            [*command, f"res://{template.name}"], capture_output=True, text=True, timeout=60,
            check=False,
        )  # fmt: skip
        assert "ERROR" not in done.stderr, f"{template}: {done.stderr}"


@pytest.mark.engine
@pytest.mark.parametrize("kind", KINDS)
def test_a_new_project_is_played_by_hand(kind: str, tmp_path: Path) -> None:
    game = tmp_path / "game"
    assert main(["new", str(game), f"--{kind}"]) == 0
    command = [str(find_engine(EngineKind.GODOT4).executable(headless=True)), "--headless"]
    command += ["--path", str(game)]
    subprocess.run([*command, "--import"], capture_output=True, check=True, timeout=120)
    done = subprocess.run(
        [*command, "--fixed-fps", "60", "--quit-after", "30"], capture_output=True, text=True,
        timeout=60, check=False,
    )  # fmt: skip
    assert "ERROR" not in done.stdout + done.stderr, done.stdout + done.stderr
