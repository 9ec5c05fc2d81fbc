"""What agents of a Bevy game see through cameras, on a real executable that draws in software."""

from __future__ import annotations

import base64
import math
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from ludus.check import CheckConfig, run_checks
from ludus.errors import SetupError, TargetError
from ludus.record import RecordConfig, record
from ludus.session import EngineSession, LaunchOptions, open_session
from ludus.spec.batch import ActionBatch, Batch
from ludus.wire.handshake import EngineConfig
from ludus.wire.reset import ResetAction, ResetRequest
from tests.record.games import frames_of
from tests.targets import find_executable, find_game

pytestmark = [pytest.mark.engine, pytest.mark.bevy, pytest.mark.timeout(900)]

TARGET = "bevy:beacon"
NUM_WORLDS = 3
NUM_WATCHERS = 2
WIDTH, HEIGHT = 48, 36
SKY = (20, 40, 60)
# What looks.rs says of the beacon and of the eye.
BEACON_DISTANCE, BEACON_WIDTH, BEACON_HEIGHT = 4.0, 1.0, 2.0
FIELD_OF_VIEW = 1.0
LEFT, RIGHT = 0, 1

Pixels = NDArray[np.uint8]
State = dict[str, Any]


@pytest.fixture(scope="module")
def executable() -> Path:
    return find_executable(TARGET)


def open_beacon(executable: Path, **config: object) -> EngineSession:
    settings = EngineConfig(**config)  # pyright: ignore[reportArgumentType]
    return open_session(find_game(executable), settings, LaunchOptions(start_timeout_s=60.0))


@pytest.fixture(scope="module", params=["grid", "isolated"])
def session(request: pytest.FixtureRequest, executable: Path) -> Iterator[EngineSession]:
    made = open_beacon(executable, num_worlds=NUM_WORLDS, layout=request.param)
    yield made
    made.close()


def reset(session: EngineSession, seed: int | None = 1) -> Batch:
    return session.reset(ResetRequest.all_worlds(session.spec.num_worlds, seed))["watcher"]


def step(session: EngineSession, *actions: int) -> Batch:
    num_agents = session.spec.num_worlds * NUM_WATCHERS
    chosen = np.resize(np.array(actions, np.int64), (num_agents, 1))
    session.send({"watcher": ActionBatch(chosen, np.zeros((num_agents, 0), np.float32))})
    return session.receive()["watcher"]


def state(session: EngineSession, world: int) -> State:
    return session.call({"world": world}, "state")


def expected_pixel(state: State, watcher: int, row: int, column: int) -> tuple[int, ...] | None:
    """Return the colour that follows from the state; None at an edge of the beacon.

    The front of the beacon is a rectangle that faces the middle; its sides are never seen from
    there, as they are narrower than the front when looked at from the middle.
    """
    scale = math.tan(FIELD_OF_VIEW / 2)
    error = state["headings"][watcher] - state["direction"]
    distance = BEACON_DISTANCE - BEACON_WIDTH / 2
    colours: set[tuple[int, ...]] = set()
    for d_row in (-0.1, 1.1):
        for d_column in (-0.1, 1.1):
            x = ((column + d_column) / WIDTH * 2 - 1) * scale * WIDTH / HEIGHT
            y = (1 - (row + d_row) / HEIGHT * 2) * scale
            # The ray (x, y, -1), turned so that the beacon stands ahead.
            ahead = math.cos(error) + x * math.sin(error)
            aside = x * math.cos(error) - math.sin(error)
            is_hit = (
                ahead > 0
                and abs(aside / ahead * distance) < BEACON_WIDTH / 2
                and abs(y / ahead * distance) < BEACON_HEIGHT / 2
            )
            colours.add(tuple(state["colour"]) if is_hit else SKY)
    return colours.pop() if len(colours) == 1 else None


def is_colour(pixel: Pixels, colour: Sequence[int]) -> bool:
    """Compare with a colour; renderers may miss it by one where they round."""
    return int(np.abs(pixel.astype(int) - np.array(colour)).max()) <= 1


def check_picture(picture: Pixels, state: State, watcher: int) -> int:
    """Compare a picture with the state; return how many pixels show the beacon."""
    num_seen = 0
    for row in range(HEIGHT):
        for column in range(WIDTH):
            colour = expected_pixel(state, watcher, row, column)
            if colour is not None:
                where = (row, column, watcher, state)
                assert is_colour(picture[row, column], colour), where
                num_seen += colour != SKY
    return num_seen


def check_pictures(session: EngineSession, batch: Batch) -> int:
    pictures = batch.observation["eye"]
    num_seen = 0
    for slot in np.flatnonzero(batch.active):
        world, watcher = divmod(int(slot), NUM_WATCHERS)
        num_seen += check_picture(pictures[slot], state(session, world), watcher)
    return num_seen


def test_the_entry_is_bytes_with_channels_last(session: EngineSession) -> None:
    (entry,) = session.policies["watcher"].observation
    assert (entry.name, entry.dtype, entry.shape) == ("eye", "uint8", (HEIGHT, WIDTH, 3))


def test_pixels_follow_from_the_state_of_this_step(session: EngineSession) -> None:
    """Of every agent in every world, in the first observation as in later ones."""
    num_seen = check_pictures(session, reset(session))
    for number in range(25):
        num_seen += check_pictures(session, step(session, number // 5 % 2))
    assert num_seen > 1000


def test_the_first_picture_of_an_episode_shows_its_beacon(session: EngineSession) -> None:
    """Worlds are made anew each time, with other colours and directions."""
    num_seen = sum(check_pictures(session, reset(session, seed)) for seed in range(10, 22))
    assert num_seen > 500


def test_the_final_observation_shows_the_end(session: EngineSession) -> None:
    """The one who finds the beacon sees it in the middle; then its next episode begins."""
    batch = reset(session, 3)
    num_final = 0
    for _ in range(60):
        before = [state(session, world) for world in range(NUM_WORLDS)]
        batch = step(session, LEFT)
        for slot, picture in zip(batch.final_index, batch.final_observation["eye"], strict=True):
            world = int(slot) // NUM_WATCHERS
            assert batch.terminated[slot] or batch.truncated[slot]
            if batch.terminated[slot]:
                assert is_colour(picture[HEIGHT // 2, WIDTH // 2], before[world]["colour"])
                num_final += 1
        check_pictures(session, batch)
    assert num_final >= 3


def test_a_world_that_is_left_alone_keeps_its_pictures(session: EngineSession) -> None:
    before = reset(session, 5).observation["eye"].copy()
    actions = [ResetAction.SEED, ResetAction.LEAVE, ResetAction.LEAVE]
    request = ResetRequest(
        seeds=np.full(NUM_WORLDS, 99, np.uint64), actions=np.array(actions, np.uint8)
    )
    after = session.reset(request)["watcher"]
    assert (after.observation["eye"][NUM_WATCHERS:] == before[NUM_WATCHERS:]).all()
    check_pictures(session, after)


def test_equal_seeds_give_equal_pixels(session: EngineSession) -> None:
    def play() -> bytes:
        batches = [reset(session, 7), *(step(session, LEFT, RIGHT) for _ in range(5))]
        return b"".join(batch.observation["eye"].tobytes() for batch in batches)

    first = play()
    step(session, RIGHT)
    assert play() == first


def test_a_film_camera_shows_one_world(session: EngineSession) -> None:
    reset(session, 2)
    for world in range(NUM_WORLDS):
        (picture,) = session.call({"world": world}, "picture")
        assert (picture["width"], picture["height"]) == (320, 320)
        pixels = np.frombuffer(base64.b64decode(picture["rgb"]), np.uint8).reshape(-1, 3)
        colour = state(session, world)["colour"]
        num_seen = sum(is_colour(pixel, colour) for pixel in pixels)
        assert 500 < num_seen < 5000, "the first picture shows this world's beacon"
    check_pictures(session, step(session, LEFT))


def test_ludus_record_films_a_world(executable: Path, tmp_path: Path) -> None:
    out = tmp_path / "film.mp4"
    recorded = record(RecordConfig(target=str(executable), out=out, is_random=True, seconds=1.0))
    assert (recorded.num_frames, float(recorded.frames_per_second)) == (15, 15.0)
    frames = frames_of(out)
    assert frames[0].shape == (320, 320, 3)
    assert all(frame.std() > 10.0 for frame in frames), "the beacon is seen from the first frame on"
    assert not np.array_equal(frames[0], frames[-1]), "the watchers turn"


def test_nobody_films_a_game_that_nobody_plays(executable: Path, tmp_path: Path) -> None:
    with pytest.raises(TargetError, match="only while somebody plays"):
        record(RecordConfig(target=str(executable), out=tmp_path / "film.mp4"))


@pytest.mark.parametrize(("layout", "num_worlds"), [("grid", 70), ("isolated", 12)])
def test_many_worlds_see_themselves(executable: Path, layout: str, num_worlds: int) -> None:
    """More than a word of render layers has bits; more renderers than there are threads."""
    session = open_beacon(executable, num_worlds=num_worlds, layout=layout)
    batch = reset(session)
    for _ in range(40):
        batch = step(session, LEFT, RIGHT)
    for slot in range(0, num_worlds * NUM_WATCHERS, 3):
        world, watcher = divmod(slot, NUM_WATCHERS)
        check_picture(batch.observation["eye"][slot], state(session, world), watcher)
    session.close()


def test_the_checks_of_ludus_pass(executable: Path) -> None:
    """Also that both layouts play the same."""
    config = CheckConfig(target=str(executable), num_steps=40, num_layout_worlds=3, timing_s=0.05)
    report = run_checks(config)
    wrong = [(name, found.title) for name, found in report.findings if str(found.status) == "fail"]
    assert wrong == []
    (verdict, *_) = (found for name, found in report.findings if name == "layouts")
    assert verdict.data["verdict"] == "equal to the bit"


def test_without_a_renderer_the_game_says_so(
    executable: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("WGPU_BACKEND", "metal")
    with pytest.raises(SetupError, match="has cameras") as caught:
        open_beacon(executable)
    assert "libegl1" in caught.value.hint
    assert os.environ["WGPU_BACKEND"] == "metal"
