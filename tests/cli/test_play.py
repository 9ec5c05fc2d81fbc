"""``ludus play``: what it refuses, and what it plays without a window."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from ludus.cli.main import main
from ludus.engine.bundled import bundled_root

ORACLE = str(bundled_root() / "examples/identity/oracle.tscn")


@pytest.fixture
def no_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setattr("sys.platform", "linux")


@pytest.mark.usefixtures("no_screen")
@pytest.mark.parametrize("flags", [[], ["--random"]])
def test_a_missing_screen_is_said_plainly(
    flags: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["play", ORACLE, *flags]) == 3
    error = capsys.readouterr().err
    assert "no screen" in error
    assert "--headless" in error


@pytest.mark.parametrize(
    ("flags", "reason"),
    [
        (["--headless"], "a game cannot be played by hand without a window"),
        (["--random", "--episodes", "0"], "episodes must be at least 1"),
        (["--stochastic", "--deterministic"], "exclude each other"),
    ],
)
def test_contradictions_are_refused(
    flags: list[str], reason: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["play", ORACLE, *flags]) == 2
    assert reason in capsys.readouterr().err


@pytest.mark.usefixtures("no_screen")
@pytest.mark.parametrize(
    "command", [["play"], ["play", "--headless"], ["play", "--random"], ["evaluate", "--random"]]
)
def test_a_policy_file_is_no_game(
    command: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "hero.ludus.json"
    file.touch()
    assert main([*command, str(file)]) == 2
    error = capsys.readouterr().err
    assert f"{file} is a policy file, and {command[0]} needs a game" in error
    assert "ludus evaluate GAME --policy FILE" in error


@pytest.mark.engine
def test_random_play_without_a_window_prints_returns(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["play", ORACLE, "--random", "--headless", "--episodes", "3"]) == 0
    lines = capsys.readouterr().out.splitlines()
    # Rewards of 0.1 to 0.5 in the five steps of an episode.
    *episodes, mean = lines
    assert episodes == [f"oracle: episode {i}, return 1.5 in 5 steps" for i in (1, 2, 3)]
    assert mean == "oracle: mean return 1.5 of 3 episodes"


@pytest.mark.engine
def test_a_run_plays_what_it_has_learnt(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    runs = str(tmp_path)
    train = ["train", "cartpole", "--runs", runs, "--name", "r", "--total-steps", "256"]
    assert main([*train, "--num-worlds", "4", "--evaluation-episodes", "0"]) == 0
    capsys.readouterr()
    for flags in ([], ["--stochastic"]):
        play = ["play", str(tmp_path / "r"), "--headless", "--episodes", "2", *flags]
        assert main(play) == 0
        output = capsys.readouterr().out
        assert len(re.findall(r"^cart: episode [12], return \d+ in \d+ steps$", output, re.M)) == 2
