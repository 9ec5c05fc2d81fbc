"""The rules of apple_seeker, against geometry computed here."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ludus.engine import EngineKind, EngineProcess, GodotFlags, LaunchConfig
from ludus.engine.bundled import bundled_root
from ludus.model import read_model
from ludus.play.command_line import play_command
from ludus.play.in_engine import EPISODE
from ludus.session import EngineSession, open_session
from ludus.spec.batch import ActionBatch, Batch
from ludus.wire.handshake import EngineConfig
from ludus.wire.reset import ResetRequest
from tests.apple_room import (
    DIRECTIONS,
    FURNITURE,
    REACH,
    SIGHT,
    SPOTS,
    START,
    Point,
    distances_to_furniture,
    seen_from,
)
from tests.targets import find_game

pytestmark = pytest.mark.engine

NUM_WORLDS = 3
STEP_LENGTH = 5.0 * 4 / 60
RIGHT, LEFT, UP, DOWN = range(4)
MOVES = {RIGHT: (1, 0), LEFT: (-1, 0), UP: (0, -1), DOWN: (0, 1)}


@pytest.fixture(params=["isolated", "grid"])
def session(request: pytest.FixtureRequest) -> Iterator[EngineSession]:
    config = EngineConfig(num_worlds=NUM_WORLDS, layout=request.param)
    made = open_session(find_game("godot3:apple_seeker"), config)
    yield made
    made.close()


def reset(session: EngineSession, seed: int | None = 1, **parameters: Any) -> Batch:
    return session.reset(ResetRequest.all_worlds(NUM_WORLDS, seed, parameters))["robot"]


def step(session: EngineSession, *actions: int) -> Batch:
    """Take one step: one action for all worlds, or one for each."""
    chosen = np.array(actions if len(actions) > 1 else actions * NUM_WORLDS, np.int64)
    nothing = np.zeros((NUM_WORLDS, 0), np.float32)
    session.send({"robot": ActionBatch(chosen[:, np.newaxis], nothing)})
    return session.receive()["robot"]


def is_free_place(place: Point) -> bool:
    """Return whether the robot fits there, 1 cm away from everything."""
    points = np.array(place) + 0.36 * np.concatenate([DIRECTIONS, np.zeros((1, 2))])
    inside = [
        (points > np.array(box)[:, 0]).all(1) & (points < np.array(box)[:, 1]).all(1)
        for box in FURNITURE
    ]
    return not np.any(inside) and distances_to_furniture(place).min() > 0.36


def free_places(count: int) -> list[Point]:
    rng = np.random.default_rng(5)
    drawn = rng.uniform([-3.6, -2.6], [3.6, 2.6], (20 * count, 2))
    is_free = [is_free_place((x, z)) for x, z in drawn]
    return [(float(x), float(z)) for x, z in drawn[is_free]][:count]


def test_rays_meet_what_geometry_says(session: EngineSession) -> None:
    num_seen = 0
    for i, place in enumerate(free_places(60)):
        apple = SPOTS[i % len(SPOTS)]
        if np.hypot(place[0] - apple[0], place[1] - apple[1]) < REACH:
            continue
        if i < len(SPOTS):
            reset(session, spot=i)
        else:
            reset(session, None, spot=i % len(SPOTS))
        world = {"world": i % NUM_WORLDS}
        session.call(world, "put_robot", list(place))
        got = session.call(world, "get_observation")
        obstacle, target = seen_from(place, apple)
        assert np.array(got["distances_to_obstacle"]) == pytest.approx(obstacle, abs=5e-3)
        assert np.array(got["distances_to_target"]) == pytest.approx(target, abs=5e-3)
        num_seen += int(target.min() < SIGHT)
    assert num_seen > 10


def test_it_starts_where_the_rules_say(session: EngineSession) -> None:
    states = np.array(
        [
            session.call({"world": world}, "get_state")
            for seed in range(8)
            for world in range(NUM_WORLDS)
            if reset(session, NUM_WORLDS * seed).active.all()
        ]
    )
    assert np.abs(states[:, :2] - START).max() <= 0.3 + 1e-6
    assert np.ptp(states[:, :2], axis=0).min() > 0.3
    apples = {(round(x, 3), round(z, 3)) for x, z in states[:, 2:]}
    assert apples <= set(SPOTS)
    assert len(apples) >= 5


@pytest.mark.parametrize("action", MOVES)
def test_a_step_is_a_third_of_a_metre(session: EngineSession, action: int) -> None:
    reset(session, start_offset=0.0, spot=0)
    step(session, action)
    for world in range(NUM_WORLDS):
        x, z, *_ = session.call({"world": world}, "get_state")
        expected = np.array(START) + np.array(MOVES[action]) * STEP_LENGTH
        assert (x, z) == pytest.approx(tuple(expected), abs=1e-4)


def test_furniture_and_walls_stop_it(session: EngineSession) -> None:
    batch = reset(session, start_offset=0.0, spot=0)
    for _ in range(20):
        batch = step(session, RIGHT, LEFT, UP)
    distances = batch.observation["distances_to_obstacle"]
    for world, ray in ((0, 0), (1, 8), (2, 12)):
        assert distances[world, ray] == pytest.approx(0.35, abs=0.01)


def test_the_reward_is_the_nearness_of_what_is_seen(session: EngineSession) -> None:
    reset(session, start_offset=0.0, spot=9)
    rewards: list[float] = []
    for action in (DOWN, RIGHT, DOWN, LEFT, RIGHT, UP):
        batch = step(session, action)
        nearest = batch.observation["distances_to_target"].min(axis=1)
        assert not batch.terminated.any()
        assert batch.reward == pytest.approx(-nearest / SIGHT, abs=1e-6)
        rewards += list(batch.reward)
    assert min(rewards) == -1.0 < max(rewards)


@pytest.mark.parametrize("faraway", [REACH + 0.01, REACH - 0.01])
def test_the_apple_is_caught_within_reach(session: EngineSession, faraway: float) -> None:
    reset(session, start_offset=0.0, spot=1)
    x, z = SPOTS[1]
    session.call({"world": 1}, "put_robot", [x, z + faraway + STEP_LENGTH])
    batch = step(session, UP)
    is_caught = faraway < REACH
    assert list(batch.terminated) == [False, is_caught, False]
    assert (batch.reward[1] == 100.0) == is_caught
    assert not batch.truncated.any()


def test_an_episode_has_500_steps_at_most(session: EngineSession) -> None:
    reset(session, start_offset=0.0, spot=0)
    for _ in range(499):
        assert not step(session, LEFT).truncated.any()
    assert step(session, LEFT).truncated.all()


def test_speed_is_a_parameter(session: EngineSession) -> None:
    reset(session, start_offset=0.0, spot=0, speed=2.5)
    step(session, DOWN)
    _, z, *_ = session.call({"world": 0}, "get_state")
    assert z == pytest.approx(START[1] + STEP_LENGTH / 2, abs=1e-4)


def test_equal_seeds_give_equal_bits(session: EngineSession) -> None:
    def play() -> list[bytes]:
        actions = np.random.default_rng(3).integers(0, 4, (40, NUM_WORLDS))
        batches = [reset(session, 7), *(step(session, *row) for row in actions)]
        return [
            b"".join(part.tobytes() for part in batch.observation.values()) for batch in batches
        ]

    assert play() == play()


def reports(log: Path, count: int, deadline_s: float) -> list[dict[str, Any]]:
    """Wait until a game has reported so many episodes."""
    deadline = time.monotonic() + deadline_s
    lines: list[str] = []
    while len(lines) < count:
        assert time.monotonic() < deadline, f"{len(lines)} episodes"
        time.sleep(0.05)
        text = log.read_text() if log.exists() else ""
        *whole, _ = text.split("\n")
        lines = [line for line in whole if line.startswith(EPISODE)]
    return [json.loads(line.removeprefix(EPISODE)) for line in lines[:count]]


def test_the_shipped_robot_catches_the_apple_without_python(tmp_path: Path) -> None:
    file = bundled_root(EngineKind.GODOT3) / "examples/apple_seeker/robot.ludus.json"
    assert file.stat().st_size < 300_000
    assert read_model(file).policy == "robot"
    target = find_game("godot3:apple_seeker", scene="res://examples/apple_seeker/trained.tscn")
    log = tmp_path / "game.log"
    command = play_command(target, GodotFlags(user_args=("--ludus-report",)))
    with EngineProcess.start(LaunchConfig(command=command, log_path=log)):
        lengths = [report["length"] for report in reports(log, 100, 120.0)]
    assert np.mean(np.array(lengths) < 500) >= 0.95
    assert np.mean(lengths) < 30
