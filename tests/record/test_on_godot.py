"""Films of real games, Godot 4 and Godot 3: every frame once, none missing."""

from __future__ import annotations

import itertools
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest

from ludus.cli.main import main
from ludus.engine import EngineKind, find_engine
from ludus.errors import ConfigError, EngineError, RunError, SetupError, TargetError
from ludus.record import Film, RecordConfig, record
from ludus.record.film import Frame
from tests.record.games import STEPS, frames_of, read_ticks, ticks_project, times_of

pytestmark = [
    pytest.mark.engine,
    pytest.mark.games,
    pytest.mark.screen,
    pytest.mark.timeout(240),
]

KINDS = ["godot4", "godot3"]


@pytest.fixture(scope="module", params=KINDS)
def project(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    kind = str(request.param)
    find_engine(EngineKind(kind))
    return ticks_project(tmp_path_factory.mktemp("record") / kind, kind)


@pytest.fixture(autouse=True)
def _no_screen(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Films must not need a desktop."""
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    yield
    assert "DISPLAY" not in os.environ


def test_an_episode_has_one_frame_for_each_step(project: Path, films: Path) -> None:
    """A step is two ticks; the film has every second frame of the game."""
    out = films / "film.mp4"
    recorded = record(RecordConfig(target=str(project), out=out, is_random=True, num_episodes=1))
    assert read_ticks(out) == list(range(2, 2 * STEPS + 1, 2))
    assert np.diff(times_of(out)) == pytest.approx(1 / 30, abs=1e-6)
    assert frames_of(out)[0].shape == (180, 320, 3)
    assert recorded.num_episodes == {"agent": 1}
    assert (recorded.num_frames, recorded.seconds) == (STEPS, pytest.approx(STEPS / 30))


def test_every_frame_of_the_game_by_command(
    project: Path, films: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = films / "film.webm"
    command = ["record", str(project), "--random", "--fps", "60", "--seconds", "1", "--start"]
    assert main([*command, "0.1", "--width", "160", "--out", str(out)]) == 0
    ticks = read_ticks(out)
    assert ticks[:4] == [7, 8, 9, 10]
    assert [(now - before) % 40 for before, now in itertools.pairwise(ticks)] == [1] * 59
    assert frames_of(out)[0].shape == (90, 160, 3)
    said = capsys.readouterr().out
    assert said == f"{out}: 60 frames, 1.00 s, 60 frames/s, agent: 1 episodes\n"


def test_a_game_that_nobody_plays(project: Path, films: Path) -> None:
    out = films / "film.gif"
    recorded = record(RecordConfig(target=str(project / "ticks.tscn"), out=out, seconds=1.0))
    ticks = read_ticks(out)
    assert len(ticks) == 20
    # On a busy machine some frames pass before the film begins, and the picture shows a byte.
    assert (np.diff(ticks) % 256).tolist() == [3] * 19
    assert recorded.num_episodes == {}


def test_the_window_may_be_larger(project: Path, films: Path) -> None:
    out = films / "film.mp4"
    config = RecordConfig(target=str(project), out=out, seconds=0.1, window=(400, 240))
    assert record(config).num_frames == 3
    assert frames_of(out)[0].shape == (240, 400, 3)


def test_a_game_that_dies(project: Path, films: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TICKS_DIE", "1")
    config = RecordConfig(target=str(project), out=films / "film.mp4", is_random=True)
    with pytest.raises(EngineError, match=r"SIGKILL|closed the connection"):
        record(config)
    assert list(films.iterdir()) == []


@pytest.mark.parametrize("is_random", [True, False])
def test_a_film_that_cannot_be_written(
    project: Path, films: Path, monkeypatch: pytest.MonkeyPatch, is_random: bool
) -> None:
    add = Film.add

    def fill_disk(film: Film, frame: Frame) -> None:
        if film.num_frames == 3:
            raise RunError("the disk is full")
        add(film, frame)

    monkeypatch.setattr(Film, "add", fill_disk)
    began = time.monotonic()
    with pytest.raises(RunError, match="the disk is full"):
        record(RecordConfig(target=str(project), out=films / "film.mp4", is_random=is_random))
    assert time.monotonic() - began < 50.0, "nobody waits for the game's deadline"
    assert list(films.iterdir()) == []


def test_without_xvfb(project: Path, films: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ludus.engine.screen.find_xvfb", lambda: None)
    with pytest.raises(SetupError, match="neither one nor Xvfb") as caught:
        record(RecordConfig(target=str(project), out=films / "film.mp4"))
    assert "apt install xvfb" in caught.value.hint


def test_an_engine_without_a_renderer(films: Path, tmp_path: Path) -> None:
    """Godot 3 has a build of its own for machines without a screen."""
    engine = find_engine(EngineKind.GODOT3)
    server = tmp_path / "godot3-server"
    server.write_text(f'#!/bin/sh\nexec {engine.path} "$@"\n')
    server.chmod(0o755)
    folder = ticks_project(tmp_path / "game", "godot3")
    with pytest.raises(SetupError, match="has no renderer") as caught:
        record(RecordConfig(target=str(folder), out=films / "film.mp4", godot=server))
    assert "ludus engine install godot3 --rendering" in caught.value.hint


def test_what_has_no_window(films: Path, tmp_path: Path) -> None:
    out = films / "film.mp4"
    for target in ("play", "127.0.0.1:4"):
        with pytest.raises(TargetError, match="window cannot be filmed"):
            record(RecordConfig(target=target, out=out))
    game = tmp_path / "game.x86_64"
    game.write_text("#!/bin/sh\n")
    game.chmod(0o755)
    with pytest.raises(TargetError, match="exported game") as caught:
        record(RecordConfig(target=str(game), out=out))
    assert "project" in caught.value.hint


def test_settings_that_contradict(project: Path, films: Path) -> None:
    out = films / "film.mp4"
    wrong: list[tuple[dict[str, Any], str]] = [
        ({"num_episodes": 1}, "nobody plays"),
        ({"num_episodes": 0, "is_random": True}, "at least 1"),
        ({"seconds": 0.0}, "seconds must be above 0"),
        ({"policy": (films,), "is_random": True}, "exclude each other"),
        ({"policy": (films / "no.ludus.json",)}, "there is no run or policy file"),
        ({"frames_per_second": 25.0}, "cannot have 25 frames"),
    ]
    for settings, what in wrong:
        with pytest.raises(ConfigError, match=what):
            record(RecordConfig(target=str(project), out=out, **settings))


WAIT = """
import sys
from pathlib import Path
from typing import Any
from ludus.record import Film, RecordConfig, record
from ludus.record.film import Frame
record(RecordConfig(target=sys.argv[1], out=Path(sys.argv[2]), seconds=300.0))
"""


def test_the_game_and_its_screen_go_with_python(project: Path, films: Path) -> None:
    with subprocess.Popen([sys.executable, "-c", WAIT, str(project), films / "film.mp4"]) as maker:
        parent = psutil.Process(maker.pid)
        deadline = time.monotonic() + 60.0
        while not list(films.iterdir()) and time.monotonic() < deadline:
            time.sleep(0.1)
        started = parent.children(recursive=True)
        maker.kill()
    assert len(started) >= 2
    assert psutil.wait_procs(started, timeout=30.0)[1] == []
    for file in films.iterdir():
        file.unlink()
