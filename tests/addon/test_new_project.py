"""``ludus new`` and script templates: what it makes passes the check and trains, in real Godot."""

from __future__ import annotations

import contextlib
import io
import subprocess
from dataclasses import dataclass
from pathlib import Path

import pytest

import ludus
from ludus.check import CheckConfig, Status, run_checks
from ludus.cli.main import main
from ludus.engine import EngineKind, ensure_imported, find_engine, read_project
from ludus.settings.train_config import PPOConfig, TrainConfig

KINDS = ("2d", "3d", "simulation")


@dataclass(frozen=True)
class Made:
    """A new project that has been opened in the editor once, which imports it.

    Attributes:
        kind: Which project.
        folder: Of the project.
        told: What ``ludus new`` printed.
        editor: What the editor printed.
    """

    kind: str
    folder: Path
    told: str
    editor: str


@pytest.fixture(scope="module", params=KINDS)
def made(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Made:
    folder = tmp_path_factory.mktemp("new") / "my-game"
    with contextlib.redirect_stdout(io.StringIO()) as told:
        assert main(["new", str(folder), f"--{request.param}"]) == 0
    printed: list[str] = []

    def open_in_editor(*_: object) -> None:
        printed.append(run_godot(folder, "--editor", "--quit"))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("ludus.engine.importing._run_import", open_in_editor)
        ensure_imported(find_engine(EngineKind.GODOT4), read_project(folder))
    return Made(request.param, folder, told.getvalue(), *printed)


def run_godot(project: Path, *arguments: str) -> str:
    """Return what Godot prints."""
    godot = str(find_engine(EngineKind.GODOT4).executable(headless=True))
    command = [godot, "--headless", "--path", str(project), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    return done.stdout + done.stderr


@pytest.mark.engine
@pytest.mark.games
def test_a_new_project_opens_in_the_editor_and_is_played_by_hand(made: Made) -> None:
    assert "ERROR" not in made.editor
    assert "ERROR" not in run_godot(made.folder, "--fixed-fps", "60", "--quit-after", "30")


@pytest.mark.engine
@pytest.mark.games
def test_a_new_project_passes_the_check_and_trains(made: Made, tmp_path: Path) -> None:
    assert f"ludus train {made.folder}" in made.told
    assert 'config/name="my-game"' in (made.folder / "project.godot").read_text()
    report = run_checks(
        CheckConfig(target=made.folder, num_steps=210, num_layout_worlds=4, timing_s=0.1)
    )
    bad = {Status.FAIL, Status.WARN}
    wrong = [finding for _, finding in report.findings if finding.status in bad]
    if made.kind == "3d":  # the floor is flat: nothing is above or below
        assert [finding.data["elements"] for finding in wrong] == [[1, 4, 7]], wrong
    else:
        assert not wrong, wrong
    config = TrainConfig(
        target=str(made.folder), num_worlds=2, num_engines=1, total_steps=64,
        runs=tmp_path / "runs", evaluation_episodes=2,
        ppo=PPOConfig(rollout_steps=8, hidden_sizes=(8,)),
    )  # fmt: skip
    run = ludus.train(config, progress=False)
    assert len(run.evaluation) == 1


def test_nothing_is_overwritten(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "kept.txt").write_text("mine")
    assert main(["new", str(tmp_path)]) == 2
    assert "exists already" in capsys.readouterr().err
    assert [file.name for file in tmp_path.iterdir()] == ["kept.txt"]
    assert main(["new", str(tmp_path / "x"), "--2d", "--3d"]) == 2
    assert main(["new", str(tmp_path / 'a"b')]) == 2
    assert main(["new", str(tmp_path / "2nd"), "--bevy"]) == 2
    assert "no digit first" in capsys.readouterr().err


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
    assert "new: script_templates/.gdignore (keeps Godot from importing the templates)" in told
    assert own.read_text() == "# mine\n"
    assert (tmp_path / "script_templates" / ".gdignore").exists()
    assert main(["addon", "install", str(tmp_path)]) == 0
    assert "new:" not in capsys.readouterr().out.replace(" 0 new", "")


# Prints errors of the engine for each script that is wrong.
LOADER = """\
extends SceneTree
func _init() -> void:
	for path in OS.get_cmdline_user_args():
		assert(load(path).can_instantiate(), path)
		print("loaded ", path)
	quit()
"""


@pytest.mark.engine
@pytest.mark.games
def test_scripts_made_of_the_templates_are_valid(tmp_path: Path) -> None:
    game = tmp_path / "game"
    assert main(["new", str(game)]) == 0
    (game / "loader.gd").write_text(LOADER)
    scripts: list[str] = []
    for template in (game / "script_templates").rglob("*.gd"):
        (game / template.name).write_text(template.read_text().replace("_BASE_", "Node2D"))
        scripts.append(f"res://{template.name}")
    assert scripts
    run_godot(game, "--import")
    said = run_godot(game, "--script", "res://loader.gd", "--", *scripts)
    assert "ERROR" not in said, said
    assert said.count("loaded") == len(scripts)
