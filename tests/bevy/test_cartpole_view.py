"""What a film of the Bevy example "cartpole" shows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from ludus.engine.bundled import bevy_workspace
from ludus.record import RecordConfig, record
from tests.record.games import frames_of
from tests.targets import find_executable

pytestmark = [pytest.mark.engine, pytest.mark.bevy, pytest.mark.timeout(900)]

TARGET = "bevy:cartpole"
CART, POLE, POST = (37, 99, 235), (230, 90, 30), (168, 140, 110)
"""Colours, as view.rs says."""

WIDTH, HEIGHT = 480, 270
FALLEN_DEGREES = 22.5
"""Where an episode ends, see main.rs."""


def places(frame: NDArray[np.uint8], colour: tuple[int, int, int]) -> NDArray[np.int64]:
    """Return rows and columns of the pixels of a colour."""
    distance = np.abs(frame.astype(np.int64) - colour).max(axis=2)
    return np.argwhere(distance < 40)


def tilt_degrees(frame: NDArray[np.uint8]) -> float:
    """Measure how far the pole leans to the right."""
    pole = places(frame, POLE)
    columns = [pole[pole[:, 0] == row, 1].mean() for row in np.unique(pole[:, 0])]
    return float(-np.degrees(np.arctan(np.polyfit(np.unique(pole[:, 0]), columns, 1)[0])))


def film(out: Path, seconds: float, *policy: Path) -> list[NDArray[np.uint8]]:
    config = RecordConfig(
        target=TARGET, out=out, policy=policy, is_random=not policy, seconds=seconds, seed=1
    )
    assert record(config).num_frames == round(seconds * 30)
    return frames_of(out)


def test_a_build_for_films_leaves_the_other_alone() -> None:
    before = find_executable(TARGET)
    assert before is not None
    content = before.read_bytes()
    pictured = find_executable(f"{TARGET}+view")
    assert pictured is not None
    assert before.read_bytes() == content != pictured.read_bytes()
    again = find_executable(TARGET)
    assert again == before
    assert before.read_bytes() == content


def test_a_trained_policy_keeps_the_pole_up(tmp_path: Path) -> None:
    root = bevy_workspace()
    assert root is not None
    frames = film(tmp_path / "film.mp4", 3.0, root / "examples/cartpole/cart.ludus.json")
    posts: set[bytes] = set()
    for frame in frames:
        assert frame.shape == (HEIGHT, WIDTH, 3)
        cart, pole = places(frame, CART), places(frame, POLE)
        # The camera goes along with the cart, and the posts pass by.
        assert abs(cart[:, 1].mean() - WIDTH / 2) < 2.0
        assert len(cart) > 400
        assert len(pole) > 500
        assert pole[:, 0].max() < cart[:, 0].mean(), "the pole is above the cart"
        assert abs(tilt_degrees(frame)) < FALLEN_DEGREES / 4.0
        posts.add(places(frame, POST).tobytes())
    assert len(posts) > len(frames) // 4, "the cart moves"


def test_random_play_lets_the_pole_fall_to_either_side(tmp_path: Path) -> None:
    tilts = [tilt_degrees(frame) for frame in film(tmp_path / "film.mp4", 6.0)]
    assert min(tilts) < -FALLEN_DEGREES / 2.0
    assert max(tilts) > FALLEN_DEGREES / 2.0
    assert max(map(abs, tilts)) < FALLEN_DEGREES + 1.0, "then the next episode begins"
