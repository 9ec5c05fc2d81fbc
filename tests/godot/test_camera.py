"""What agents see through cameras, in real engines that draw: Godot 4 and 3, in 3D and in 2D."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from ludus.engine import (
    EngineKind,
    EngineProcess,
    GodotFlags,
    LaunchConfig,
    find_engine,
    godot_command,
    install_engine,
)
from ludus.errors import SetupError
from ludus.session import EngineSession, LaunchOptions, open_session
from ludus.spec.batch import ActionBatch, Batch
from ludus.wire.handshake import EngineConfig
from ludus.wire.reset import ResetAction, ResetRequest
from tests.godot.camera_games import HEIGHT, WIDTH, make_project
from tests.godot.test_attach import await_port, free_port
from tests.targets import find_game

pytestmark = [pytest.mark.engine, pytest.mark.screen]

NUM_WORLDS = 3
# Of each world: red, green, yellow.
COLOURS = [(255, 0, 0), (0, 255, 0), (255, 255, 0)]
BLUE = (0, 0, 255)
STAY, GO_RIGHT = 0, 1
# What engines make of these colours when they take the brightness: Godot 4 after ITU-R BT.709.
GREYS = {"godot3": [85, 85, 170], "godot4": [54, 182, 237]}

Pixels = NDArray[np.uint8]


@pytest.fixture(scope="module", params=["godot3", "godot4"])
def engine(request: pytest.FixtureRequest) -> str:
    """Which Godot it is; one that draws is installed if need be."""
    install_engine(EngineKind(request.param), rendering=True)
    return request.param


@pytest.fixture(scope="module")
def project(engine: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_project(tmp_path_factory.mktemp("cameras"), engine)


@pytest.fixture(scope="module", params=["box_3d", "box_2d"])
def scene(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture(scope="module", params=["isolated", "grid"])
def layout(request: pytest.FixtureRequest) -> str:
    return request.param


def open_scene(project: Path, scene: str, layout: str) -> EngineSession:
    target = find_game(project, scene=f"res://{scene}.tscn")
    return open_session(target, EngineConfig(num_worlds=NUM_WORLDS, layout=layout))


@pytest.fixture(scope="module")
def session(project: Path, scene: str, layout: str) -> Iterator[EngineSession]:
    made = open_scene(project, scene, layout)
    yield made
    made.close()


@pytest.fixture
def session_3d(project: Path, layout: str) -> Iterator[EngineSession]:
    made = open_scene(project, "box_3d", layout)
    yield made
    made.close()


def reset(session: EngineSession, seed: int | None = 1) -> Batch:
    return session.reset(ResetRequest.all_worlds(NUM_WORLDS, seed))["agent"]


def step(session: EngineSession, *actions: int) -> Batch:
    chosen = np.array(actions, np.int64)[:, np.newaxis]
    nothing = np.zeros((NUM_WORLDS, 0), np.float32)
    session.send({"agent": ActionBatch(chosen, nothing)})
    return session.receive()["agent"]


def colours_in(picture: Pixels) -> set[tuple[int, ...]]:
    """Return all colours but black."""
    found = {tuple(int(part) for part in pixel) for pixel in picture.reshape(-1, 3)}
    return found - {(0, 0, 0)}


def centre_of(picture: Pixels) -> tuple[float, float]:
    """Return row and column of the middle of what is not black, shares of the picture."""
    rows, columns = np.nonzero(picture.reshape(*picture.shape[:2], -1).any(axis=2))
    return float(rows.mean() / picture.shape[0]), float(columns.mean() / picture.shape[1])


def is_upper_left(picture: Pixels) -> bool:
    row, column = centre_of(picture)
    return row < 0.4 and column < 0.4


def test_pictures_are_bytes_with_channels_last(session: EngineSession) -> None:
    entries = {entry.name: entry for entry in session.policies["agent"].observation}
    assert entries["eye"].dtype == entries["grey"].dtype == "uint8"
    assert entries["eye"].shape == (HEIGHT, WIDTH, 3)
    assert entries["grey"].shape == (16, 16, 1)


def test_each_world_shows_its_own_box(session: EngineSession) -> None:
    pictures = reset(session).observation["eye"]
    for world, colour in enumerate(COLOURS):
        assert colours_in(pictures[world]) == {colour}
        assert is_upper_left(pictures[world])


def test_grey_is_the_brightness(session: EngineSession, engine: str) -> None:
    pictures = reset(session).observation["grey"]
    assert [int(picture.max()) for picture in pictures] == GREYS[engine]
    assert all(is_upper_left(picture) for picture in pictures)


def test_the_next_step_shows_what_moved(session: EngineSession) -> None:
    reset(session)
    batch = step(session, STAY, GO_RIGHT, STAY)
    assert batch.final_index.tolist() == [1]
    final = batch.final_observation["eye"][0]
    assert colours_in(final) == {COLOURS[1]}
    row, column = centre_of(final)
    assert row < 0.4
    assert column > 0.6
    for world, colour in enumerate(COLOURS):
        assert colours_in(batch.observation["eye"][world]) == {colour}
        assert is_upper_left(batch.observation["eye"][world])


def test_worlds_made_anew_are_seen(session: EngineSession) -> None:
    for seed in (1, 2, None, 3):
        pictures = reset(session, seed).observation["eye"]
        assert [colours_in(picture) for picture in pictures] == [{c} for c in COLOURS]


def test_a_world_that_is_reset_alone_is_seen_anew(session: EngineSession) -> None:
    reset(session)
    step(session, STAY, STAY, STAY)
    seeds = np.ones(NUM_WORLDS, np.uint64)
    for action in (ResetAction.SEED, ResetAction.SEED, ResetAction.NEXT_EPISODE):
        for start in (1.0, -1.0):
            actions = np.array([action, ResetAction.LEAVE, ResetAction.LEAVE], np.uint8)
            request = ResetRequest(seeds, actions, [{"start": start}, None, None])
            pictures = session.reset(request)["agent"].observation["eye"]
            assert (centre_of(pictures[0])[1] > 0.6) == (start > 0)
            assert is_upper_left(pictures[1])


def test_pictures_are_equal_to_the_bit(session: EngineSession) -> None:
    first = {name: part.copy() for name, part in reset(session, 4).observation.items()}
    step(session, STAY, STAY, GO_RIGHT)
    again = reset(session, 4).observation
    assert all(np.array_equal(first[name], again[name]) for name in first)


def test_a_node_that_comes_later_is_seen_in_its_world_only(session_3d: EngineSession) -> None:
    reset(session_3d)
    session_3d.call({"world": 0}, "ludus_add_box")
    pictures = step(session_3d, STAY, STAY, STAY).observation["eye"]
    assert colours_in(pictures[0]) == {COLOURS[0], BLUE}
    assert colours_in(pictures[1]) == {COLOURS[1]}
    assert colours_in(pictures[2]) == {COLOURS[2]}


def test_a_picture_is_no_frame_of_the_game(session_3d: EngineSession) -> None:
    reset(session_3d)
    step(session_3d, STAY, STAY, STAY)
    assert session_3d.call({"world": 0}, "ludus_get_num_frames") == 0


def test_refresh_shows_what_moved_between_ticks(session_3d: EngineSession) -> None:
    world = {"world": 0}
    reset(session_3d)
    before = session_3d.call(world, "ludus_see")
    session_3d.call(world, "ludus_move_box", [0.8])
    assert session_3d.call(world, "ludus_see") == before
    session_3d.call(world, "ludus_refresh")
    after = np.array(session_3d.call(world, "ludus_see"), np.uint8).reshape(HEIGHT, WIDTH, 3)
    assert centre_of(after)[1] > 0.6


def test_without_a_screen_the_error_says_what_is_missing(
    project: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for variable in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.setattr("ludus.engine.screen.find_xvfb", lambda: None)
    with pytest.raises(SetupError, match="needs a screen") as caught:
        open_scene(project, "box_3d", "isolated")
    assert "xvfb" in caught.value.hint


def test_a_game_that_cannot_draw_names_the_camera(project: Path, engine: str) -> None:
    port = free_port()
    flags = GodotFlags(user_args=(f"--ludus-listen=tcp:127.0.0.1:{port}",))
    program = find_engine(EngineKind(engine))
    command = godot_command(program, project, "res://box_3d.tscn", flags)
    with EngineProcess.start(LaunchConfig(command=command)):
        await_port(port)
        with pytest.raises(SetupError, match="camera Eye needs a renderer") as caught:
            open_session(find_game(f"127.0.0.1:{port}"), EngineConfig())
    assert f"ludus engine install {engine} --rendering" in caught.value.hint


def test_a_renderer_may_be_asked_for_at_once(project: Path) -> None:
    target = find_game(project, scene="res://box_2d.tscn")
    made = open_session(target, EngineConfig(), LaunchOptions(has_renderer=True))
    made.close()
