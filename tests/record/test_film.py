"""Films are whole or absent, every frame is in them once, and their pace is steady."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from ludus.errors import ConfigError, RunError, SetupError, UsageError
from ludus.extras import install_hint
from ludus.record import Film
from ludus.record.film_kinds import choose_rate, film_kind
from tests.record.games import HEIGHT, WIDTH, draw, frames_of, read_ticks, times_of

ENDINGS = ["mp4", "webm", "gif"]


@pytest.mark.parametrize("ending", ENDINGS)
def test_every_frame_once_at_a_steady_pace(films: Path, ending: str) -> None:
    out = films / f"ticks.{ending}"
    with Film(out, 20) as film:
        for ticks in range(60):
            film.add(draw(ticks))
        assert not out.exists()
    assert read_ticks(out) == list(range(60))
    assert np.diff(times_of(out)) == pytest.approx(0.05, abs=1e-6)
    assert film.num_frames == 60


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_film_of_another_width(films: Path, ending: str) -> None:
    out = films / f"small.{ending}"
    with Film(out, 20, width=161) as film:
        film.add(draw(5))
        film.add(np.repeat(np.repeat(draw(9), 2, 0), 2, 1))
    assert [frame.shape for frame in frames_of(out)] == [(90, 160, 3)] * 2
    assert read_ticks(out) == [5, 9]


def test_odd_sides_become_even(films: Path) -> None:
    with Film(films / "odd.mp4") as film:
        film.add(draw(1)[: HEIGHT - 1, : WIDTH - 1])
    assert frames_of(films / "odd.mp4")[0].shape == (HEIGHT, WIDTH - 2, 3)


def test_an_error_leaves_the_older_film(films: Path) -> None:
    out = films / "film.mp4"
    out.write_bytes(b"older")
    with pytest.raises(ZeroDivisionError), Film(out) as film:
        film.add(draw(1))
        _ = 1 / 0
    assert out.read_bytes() == b"older"
    assert list(films.iterdir()) == [out]


def test_no_frames_no_film(films: Path) -> None:
    with pytest.raises(UsageError, match="no frames"), Film(films / "film.mp4"):
        pass
    assert list(films.iterdir()) == []


def test_a_full_disk(films: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What /dev/full says when it is written to."""
    film = Film(films / "film.mp4")
    monkeypatch.setattr(film, "_incoming", Path("/dev/full"))
    monkeypatch.setattr(Path, "unlink", _keep)
    with pytest.raises(RunError, match="could not be written"), film:
        for ticks in range(200):
            film.add(np.random.default_rng(ticks).integers(0, 255, (90, 160, 3), np.uint8))
    monkeypatch.undo()
    assert list(films.iterdir()) == []


@pytest.mark.parametrize("frame", [np.zeros((4, 4), np.uint8), np.zeros((4, 4, 3), np.float32)])
def test_what_is_no_frame(films: Path, frame: NDArray[Any]) -> None:
    with pytest.raises(UsageError, match="must be uint8"), Film(films / "film.mp4") as film:
        film.add(frame)


def test_what_cannot_be_written(films: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ConfigError, match=r"ends in \.avi, expected \.mp4 or \.webm or \.gif"):
        Film(films / "film.avi")
    with pytest.raises(ConfigError, match="there is no folder") as caught:
        Film(films / "nowhere" / "film.mp4")
    assert "mkdir" in caught.value.hint
    with pytest.raises(ConfigError, match="frames a second"):
        Film(films / "film.mp4", 0)
    with pytest.raises(ConfigError, match="width"):
        Film(films / "film.mp4", width=1)
    monkeypatch.setattr("ludus.record.film.find_spec", _find_nothing)
    with pytest.raises(SetupError, match="av is not installed") as missing:
        Film(films / "film.mp4")
    assert missing.value.hint == install_hint("record")


def test_rates_divide_that_of_the_game() -> None:
    mp4, gif = film_kind(Path("a.mp4")), film_kind(Path("a.GIF"))
    assert choose_rate(mp4, Fraction(60), None) == 30
    assert choose_rate(gif, Fraction(60), None) == 20
    assert choose_rate(gif, Fraction(50), None) == Fraction(50, 3)
    assert choose_rate(mp4, Fraction(60), 60) == 60
    assert choose_rate(mp4, Fraction(60), 7.5) == Fraction(15, 2)
    assert choose_rate(mp4, Fraction(1), None) == 1
    with pytest.raises(ConfigError, match="cannot have 25 frames") as caught:
        choose_rate(mp4, Fraction(60), 25)
    assert caught.value.hint == "choose one of 60, 30, 20, 15, 12, 10, 8.57143, 7.5"
    with pytest.raises(ConfigError, match="must last equally long") as caught:
        choose_rate(gif, Fraction(60), 30)
    assert caught.value.hint.startswith("choose one of 20, 10, 6.66667, 5")


def _keep(_: Path, *, missing_ok: bool) -> None:
    """Delete nothing, least of all a device."""
    assert missing_ok


def _find_nothing(_: str) -> None:
    """Find no package."""
