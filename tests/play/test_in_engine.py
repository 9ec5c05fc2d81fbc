"""Following a game that plays policies itself: what it reports, and how it may end.

The games here are exported ones as far as Ludus can see: programs that print and end.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from ludus.errors import EngineCrashed, EngineTimeout, GameError
from ludus.play import in_engine as module
from ludus.play.in_engine import play_in_engine
from ludus.play.interactive import PlayConfig
from tests.godot.conftest import is_gone as is_process_gone

REPORT = """echo 'ludus-episode {"policy":"%s","return":%s,"length":7}'\n"""
Heard = list[tuple[str, int, float, int]]


def game(folder: Path, script: str) -> Path:
    path = folder / "game.sh"
    path.write_text(f'#!/bin/sh\necho $$ > {folder}/pid\necho "$@" > {folder}/args\n{script}')
    path.chmod(0o755)
    return path


def play(
    folder: Path, script: str, num_episodes: int | None = 2, is_headless: bool = True
) -> Heard:
    heard: Heard = []

    def hear(policy: str, number: int, episode_return: float, length: int) -> None:
        heard.append((policy, number, episode_return, length))

    config = PlayConfig(
        target=game(folder, script), is_headless=is_headless, num_episodes=num_episodes
    )
    files = {name: folder / f"{name}.ludus.json" for name in ("hero", "target")}
    play_in_engine(config, files, hear, is_stochastic=True)
    return heard


def is_gone(folder: Path) -> bool:
    return is_process_gone(int((folder / "pid").read_text()))


def test_every_policy_gets_its_episodes_and_no_more(tmp_path: Path) -> None:
    reports = REPORT % ("hero", "1.5") * 5 + "echo other text\n" + REPORT % ("target", "-2") * 2
    heard = play(tmp_path, reports + "sleep 60\n")
    assert heard == [
        ("hero", 1, 1.5, 7),
        ("hero", 2, 1.5, 7),
        ("target", 1, -2.0, 7),
        ("target", 2, -2.0, 7),
    ]
    assert is_gone(tmp_path)


@pytest.mark.parametrize("number", ["null", "nan", "-inf", "1e99999"])
def test_a_return_that_is_not_finite_is_an_error(tmp_path: Path, number: str) -> None:
    with pytest.raises(GameError, match=r"hero: an episode of 7 steps has the return (nan|-?inf)"):
        play(tmp_path, REPORT % ("hero", number) + "sleep 60\n")
    assert is_gone(tmp_path)


def test_the_game_is_told_what_to_play(tmp_path: Path) -> None:
    play(tmp_path, REPORT % ("hero", "1") + REPORT % ("target", "1") + "sleep 60\n", 1)
    arguments = (tmp_path / "args").read_text().split()
    assert arguments[:3] == ["--headless", "--fixed-fps", "60"]
    assert arguments[arguments.index("--") + 1 :] == [
        f"--ludus-policy=hero={tmp_path}/hero.ludus.json",
        f"--ludus-policy=target={tmp_path}/target.ludus.json",
        "--ludus-sample",
        "--ludus-report",
    ]


def test_a_window_that_is_closed_ends_the_play(tmp_path: Path) -> None:
    heard = play(tmp_path, REPORT % ("hero", "3"), num_episodes=None, is_headless=False)
    assert heard == [("hero", 1, 3.0, 7)]


@pytest.mark.parametrize("is_headless", [True, False])
def test_a_game_that_fails_is_reported(tmp_path: Path, is_headless: bool) -> None:
    with pytest.raises(EngineCrashed, match="exit code 3") as error:
        play(tmp_path, "echo it went wrong\nexit 3\n", is_headless=is_headless)
    assert "it went wrong" in error.value.message
    assert error.value.process_exit_code == 3


def test_without_a_window_a_game_may_not_end_early(tmp_path: Path) -> None:
    with pytest.raises(EngineCrashed, match="ended before its episodes had"):
        play(tmp_path, REPORT % ("hero", "1") * 5)


@pytest.mark.parametrize("text", ["{", "[]", '{"policy":"hero","return":"x","length":1}', "{}"])
def test_a_report_that_cannot_be_read_is_an_error(tmp_path: Path, text: str) -> None:
    with pytest.raises(GameError, match="reported an episode as") as error:
        play(tmp_path, f"echo 'ludus-episode {text}'\nsleep 60\n")
    assert "ludus addon install" in error.value.hint
    assert is_gone(tmp_path)


@pytest.mark.slow
def test_a_game_without_episodes_is_given_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "SILENCE_S", 2.0)
    with pytest.raises(EngineTimeout, match="no episode ended") as error:
        play(tmp_path, "sleep 60\n")
    assert "max_episode_steps" in error.value.hint
    assert is_gone(tmp_path)


def test_lines_are_read_whole_however_they_come(tmp_path: Path) -> None:
    halves = 'printf \'ludus-episode {"policy":"hero",\'\nsleep 0.3\nprintf \'"return":1,'
    heard = play(
        tmp_path,
        halves + '"length":4}\\n\'\n' + REPORT % ("target", "1") + "sleep 60\n",
        num_episodes=1,
    )
    assert heard == [("hero", 1, 1.0, 4), ("target", 1, 1.0, 7)]


def test_nothing_is_left_in_the_temporary_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    own = tmp_path / "temporary"
    own.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(own))
    play(tmp_path, REPORT % ("hero", "1"), num_episodes=None, is_headless=False)
    assert list(own.iterdir()) == []
