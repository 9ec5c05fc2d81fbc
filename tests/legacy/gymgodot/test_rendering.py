"""Frames of a real Godot 3 on a screen of our own: numbered files, arrays that show the cart."""

from __future__ import annotations

import shlex
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import gymnasium
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from ludus.engine import EngineKind, find_engine
from ludus.errors import EngineCrashed, GameError
from ludus.record import RecordConfig, record
from ludus.record.screen import screen
from tests.legacy.gymgodot.conftest import Opener, await_so, left_processes, started_processes
from tests.record.games import frames_of

pytestmark = [pytest.mark.engine, pytest.mark.screen]

PROJECT = Path(__file__).with_name("project")
SPACES: dict[str, Any] = {
    "action_space": gymnasium.spaces.Discrete(2),
    "observation_space": gymnasium.spaces.Box(-np.inf, np.inf, (4,), np.float32),
}
SHAPE = (360, 640, 3)
PIXELS_PER_METRE = 360 / 50
LEFT, RIGHT = 0, 1


def command(folder: Path, *, is_windowed: bool) -> str:
    """Return what a user would write as exeCmd."""
    program = find_engine(EngineKind.GODOT3).executable(headless=not is_windowed)
    return f"cd {shlex.quote(str(folder))} && {shlex.quote(str(program))} ./cartpole.tscn"


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("rendering") / "project"
    shutil.copytree(PROJECT, folder)
    return folder


@pytest.fixture
def _screen(opener: Opener) -> Iterator[None]:
    """A screen that stands until the games have gone."""
    with screen():
        yield
        opener.close()


def cart_column(frame: NDArray[np.uint8]) -> float:
    """Return the middle of what is as blue as the cart."""
    blue = (frame[:, :, 2] > 200) & (frame[:, :, 0] < 150)
    assert 1400 < blue.sum() < 1700, "8 by 4 metres, less the pole"
    return float(np.nonzero(blue)[1].mean())


@pytest.mark.usefixtures("_screen")
def test_frames_show_the_cart_as_it_moves(project: Path, opener: Opener) -> None:
    num_before = len(started_processes())
    env = opener.open(command(project, is_windowed=True), render_mode="rgb_array", **SPACES)
    env.reset()
    middle: Any = env.render()
    assert (middle.shape, middle.dtype) == (SHAPE, np.uint8)
    assert cart_column(middle) == pytest.approx(320, abs=2)
    columns: list[float] = []
    for action in (LEFT, RIGHT):
        env.reset()
        place = [float(env.step(action)[0][0]) for _ in range(6)][-1]
        frame: Any = env.render()
        columns.append(cart_column(frame))
        assert abs(columns[-1] - 320) == pytest.approx(abs(place) * PIXELS_PER_METRE, abs=6)
    assert columns[0] < 315 and columns[1] > 325
    env.close()
    await_so(lambda: len(started_processes()) == num_before)
    assert len(started_processes()) == num_before, "the screen is still there"


@pytest.mark.usefixtures("_screen")
def test_frames_are_saved_with_numbers(project: Path, opener: Opener, tmp_path: Path) -> None:
    folder = tmp_path / "render frames"
    folder.mkdir()
    env = opener.open(command(project, is_windowed=True), renderPath=f"{folder}/", **SPACES)
    for _ in range(2):
        env.reset()
        for _ in range(3):
            assert env.render() is None
            env.step(LEFT)
    assert sorted(file.name for file in folder.iterdir()) == ["0.png", "1.png", "2.png"]
    pictures = [np.asarray(Image.open(folder / f"{i}.png").convert("RGB")) for i in range(3)]
    assert all(picture.shape == SHAPE for picture in pictures)
    assert len({picture.tobytes() for picture in pictures}) > 1


@pytest.mark.usefixtures("_screen")
def test_missing_folder_for_frames_is_named(project: Path, opener: Opener, tmp_path: Path) -> None:
    path = f"{tmp_path}/nowhere/"
    env = opener.open(command(project, is_windowed=True), renderPath=path, **SPACES)
    env.reset()
    with pytest.raises(GameError, match=r"could not save .*nowhere/0\.png") as caught:
        env.render()
    assert "the folder must exist" in caught.value.hint


@pytest.mark.parametrize("is_windowed", [True, False])
def test_without_a_screen(
    project: Path, opener: Opener, monkeypatch: pytest.MonkeyPatch, is_windowed: bool
) -> None:
    """A build with a renderer does not start; the one without cannot save a frame."""
    monkeypatch.delenv("DISPLAY", raising=False)
    with pytest.raises((EngineCrashed, GameError)) as caught:
        env = opener.open(command(project, is_windowed=is_windowed), **SPACES)
        env.reset()
        env.render()
    assert "run godot3, not godot3-server" in caught.value.hint
    assert "xvfb-run" in caught.value.hint


def open_cartpole(project: str, render_mode: str | None = None) -> gymnasium.Env[Any, Any]:
    """Open the game as users register theirs."""
    arguments: dict[str, Any] = {"exeCmd": command(Path(project), is_windowed=True), **SPACES}
    return gymnasium.make(
        "ludus/GymGodot-v0", serverPort=0, render_mode=render_mode, **arguments
    ).unwrapped


def test_a_film_of_a_gymgodot_game(
    project: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`ludus record gym:…` brings the screen itself."""
    monkeypatch.delenv("DISPLAY", raising=False)
    out = tmp_path / "film.mp4"
    register: Any = cast(Any, gymnasium).register
    register(
        "CartPoleOfGymGodot-v0",
        entry_point="tests.legacy.gymgodot.test_rendering:open_cartpole",
        kwargs={"project": str(project)},
    )
    target = "gym:CartPoleOfGymGodot-v0"
    recorded = record(RecordConfig(target=target, out=out, num_episodes=1, is_random=True))
    frames = frames_of(out)
    assert recorded.frames_per_second == 30
    assert len(frames) == recorded.num_frames > 5
    assert {frame.shape for frame in frames} == {SHAPE}
    columns = [cart_column(frame) for frame in frames]
    assert columns[0] == pytest.approx(320, abs=2)
    assert max(columns) - min(columns) > 3
    assert left_processes() == []
