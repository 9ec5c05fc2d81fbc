"""The Bevy example "shooter" as a trainer sees it: several agents, rays, three choices at once."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
from numpy.typing import NDArray

from ludus.check import CheckConfig, Status, run_checks
from ludus.cli.main import main
from ludus.engine.bevy_build import find_bevy_example, with_view
from ludus.errors import TargetError
from ludus.session import EngineSession, LaunchOptions, open_session
from ludus.spec.batch import ActionBatch, Batch
from ludus.wire.handshake import EngineConfig
from ludus.wire.reset import ResetRequest
from tests.targets import find_executable, find_game

pytestmark = [pytest.mark.engine, pytest.mark.bevy, pytest.mark.timeout(300, func_only=True)]

TARGET = "bevy:shooter"
NUM_SHOOTERS, NUM_TARGETS, NUM_RAYS = 3, 12, 21
MIDDLE = NUM_RAYS // 2
REACH_M = 20.0 * 2.0**0.5
HIT = 0.5
"""Only the reward of a hit is above this, as a shooter shoots once a step at most."""

SKY, FLOOR = (188, 214, 235), (212, 205, 190)
"""As shapes.rs says; the floor is a little darker, as it does not face the sun."""

STAY, FORWARD = 0, 1
STRAIGHT, LEFT, RIGHT, FAST_LEFT = 0, 1, 2, 3

Choices = NDArray[np.int64]
Player = Callable[[Batch], Choices]


@pytest.fixture(scope="module")
def executable() -> Path:
    return find_executable(TARGET)


@pytest.fixture
def session(executable: Path) -> Iterator[EngineSession]:
    config = EngineConfig(num_worlds=32)
    opened = open_session(find_game(executable), config, LaunchOptions(start_timeout_s=60.0))
    yield opened
    opened.close()


def reset(session: EngineSession, seed: int = 0, **parameters: float) -> Batch:
    request = ResetRequest.all_worlds(session.spec.num_worlds, seed, parameters)
    return session.reset(request)["shooter"]


def step(session: EngineSession, choices: Choices) -> Batch:
    session.send({"shooter": ActionBatch(choices, np.zeros((len(choices), 0), np.float32))})
    return session.receive()["shooter"]


def still(session: EngineSession) -> Choices:
    return np.zeros((session.spec.num_worlds * NUM_SHOOTERS, 3), np.int64)


def play_at_random(seed: int) -> Player:
    rng = np.random.default_rng(seed)
    return lambda batch: rng.integers(0, (5, 5, 2), (len(batch.reward), 3))


def aim_and_shoot(batch: Batch) -> Choices:
    """Turn to the target whose ray is nearest to the middle, else look around and walk."""
    targets = batch.observation["targets"]
    choices = np.zeros((len(targets), 3), np.int64)
    for number, rays in enumerate(targets):
        seen = np.flatnonzero(rays < 1.0)
        if len(seen) == 0:
            choices[number] = FORWARD, FAST_LEFT, 0
        else:
            side = seen[np.abs(seen - MIDDLE).argmin()] - MIDDLE
            choices[number] = STAY, (RIGHT if side > 0 else LEFT), 0
            if side == 0:
                choices[number] = STAY, STRAIGHT, 1
    return choices


def share_hit(session: EngineSession, player: Player) -> float:
    """Play one episode in every world; return the share of their targets that were hit."""
    num_worlds = session.spec.num_worlds
    hits = np.zeros(num_worlds)
    is_over = np.zeros(num_worlds, bool)
    batch = reset(session, seed=3)
    for _ in range(600):
        batch = step(session, player(batch))
        found = (batch.reward > HIT).reshape(num_worlds, NUM_SHOOTERS).sum(axis=1)
        hits += np.where(is_over, 0, found)
        is_over |= batch.terminated.reshape(num_worlds, NUM_SHOOTERS).any(axis=1)
        if is_over.all():
            return float(hits.mean() / NUM_TARGETS)
    pytest.fail("episodes must end, as all targets come and go")


def test_handshake(session: EngineSession) -> None:
    spec = session.spec
    assert (spec.num_worlds, spec.layout, spec.ticks_per_step) == (32, "grid", 2)
    assert spec.tick_rate == 30.0
    (policy,) = spec.policies
    assert (policy.name, policy.agents_per_world, policy.episode) == ("shooter", 3, "world")
    assert [(entry.name, entry.shape) for entry in policy.observation] == [
        ("walls", (NUM_RAYS,)),
        ("targets", (NUM_RAYS,)),
        ("others", (NUM_RAYS,)),
        ("loaded", (1,)),
    ]
    assert policy.nvec == (5, 5, 2)
    assert [agent.path for agent in policy.agents[:4]] == [
        "shooter 0", "shooter 1", "shooter 2", "shooter 0",
    ]  # fmt: skip


def test_without_walls_rays_end_at_the_border_or_at_others(session: EngineSession) -> None:
    walls = reset(session, walls=0).observation["walls"] * REACH_M
    # The three rays to one straight border tell where it is: 1/d of neighbours adds up.
    inverse = 1.0 / walls
    bend = inverse[:, :-2] + inverse[:, 2:] - 2.0 * np.cos(np.radians(4.0)) * inverse[:, 1:-1]
    is_straight = np.abs(bend) < 1e-4 * inverse[:, 1:-1]
    assert is_straight.mean() > 0.8
    assert (reset(session).observation["walls"].mean() * REACH_M) < walls.mean()


def test_a_shot_needs_a_loaded_rifle(session: EngineSession) -> None:
    assert (reset(session).observation["loaded"] == 1.0).all()
    choices = still(session)
    choices[:, 2] = 1
    batch = step(session, choices)
    assert (batch.reward != 0.0).all()
    assert set(np.unique(batch.reward)) <= {np.float32(-0.3), np.float32(-0.1), np.float32(1.0)}
    assert (batch.observation["loaded"] == 0.0).all()
    for _ in range(8):
        batch = step(session, choices)
        assert (batch.reward == 0.0).all()
    assert (batch.observation["loaded"] == 1.0).all()
    assert (step(session, choices).reward != 0.0).all()


def test_a_world_ends_for_all_when_its_targets_have_come_and_gone(session: EngineSession) -> None:
    reset(session, target_seconds=0.5)
    lengths = np.zeros(session.spec.num_worlds)
    for number in range(1, 4 * (8 + 15) + 2):
        batch = step(session, still(session))
        ended = batch.terminated.reshape(-1, NUM_SHOOTERS)
        assert (ended.any(axis=1) == ended.all(axis=1)).all()
        assert not batch.truncated.any()
        lengths[(lengths == 0) & ended.any(axis=1)] = number
    # Four targets of each stand for 8 steps, and a pause of 1 to 15 before each.
    assert (lengths >= 4 * (8 + 1)).all()
    assert (lengths <= 4 * (8 + 15)).all()


def test_who_aims_hits_more_than_who_does_not(session: EngineSession) -> None:
    assert share_hit(session, lambda batch: still(session)) == 0.0
    at_random = share_hit(session, play_at_random(0))
    assert 0.05 < at_random < 0.3
    assert share_hit(session, aim_and_shoot) > at_random + 0.3


def test_ludus_check_passes(executable: Path) -> None:
    config = CheckConfig(target=TARGET, num_steps=301, num_layout_worlds=8, timing_s=0.05)
    report = run_checks(config)
    wrong = [f for _, f in report.findings if f.status in {Status.FAIL, Status.WARN}]
    assert wrong == []
    (verdict, *_) = (found for name, found in report.findings if name == "layouts")
    assert verdict.data["verdict"] == "equal to the bit"


def test_half_a_minute_of_training_beats_random_play(
    executable: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = [
        "train", TARGET, "--total-steps", "150000", "--num-worlds", "64", "--num-engines", "1",
        "--seed", "1", "--runs", str(tmp_path), "--name", "short", "--evaluation-episodes", "0",
    ]  # fmt: skip
    assert main(arguments) == 0
    capsys.readouterr()
    run = str(tmp_path / "short")
    assert main(["evaluate", run, "--episodes", "192", "--json"]) == 0
    report = json.loads(capsys.readouterr().out)["policies"]["shooter"]
    # Of at most 4. Random play gets -2.2, who never shoots 0.
    assert report["mean_return"] > 1.5


def test_features_are_part_of_the_target() -> None:
    assert find_bevy_example("bevy:shooter+view") == "shooter+view"
    assert find_bevy_example("bevy:shoter+view") is None
    assert with_view("bevy:shooter") == "bevy:shooter+view"
    assert with_view("bevy:shooter+pixels") == "bevy:shooter+pixels"
    assert with_view("bevy:cartpole") == "bevy:cartpole+view"
    assert with_view("bevy:beacon") == "bevy:beacon"
    assert with_view("cartpole") == "cartpole"
    with pytest.raises(TargetError, match="bevy:shooter has no feature 'veiw'") as caught:
        find_game("bevy:shooter+veiw")
    assert caught.value.hint == "its features: pixels, view"


@pytest.mark.timeout(900)
def test_a_film_shows_what_a_shooter_sees_and_the_arena(tmp_path: Path) -> None:
    out = tmp_path / "film.gif"
    assert main(["record", TARGET, "--random", "--seconds", "1", "--out", str(out)]) == 0
    with av.open(str(out)) as film:
        frames = [frame.to_ndarray(format="rgb24") for frame in film.decode(video=0)]
    assert len(frames) == 5
    for frame in frames:
        assert frame.shape == (270, 360 + 270, 3)
        assert near(frame[5, 180], SKY)
        # The arena from above: floor in the middle lane, the border around it.
        arena = frame[:, 360:]
        assert near(np.median(arena.reshape(-1, 3), axis=0), FLOOR)
        assert not near(arena[135, 8], FLOOR)
    assert len({frame.tobytes() for frame in frames}) == 5


@pytest.mark.timeout(900)
def test_pictures_in_the_place_of_rays() -> None:
    target = find_game(f"{TARGET}+pixels")
    options = LaunchOptions(start_timeout_s=60.0)
    session = open_session(target, EngineConfig(num_worlds=2), options)
    try:
        (policy,) = session.spec.policies
        entries = [(entry.name, entry.dtype, entry.shape) for entry in policy.observation]
        assert entries == [("loaded", "float32", (1,)), ("eye", "uint8", (48, 64, 3))]
        before = reset(session, seed=1).observation["eye"].copy()
        assert len(np.unique(before.reshape(6, -1), axis=0)) == 6
        # One of them stands before a wall.
        assert sum(near(eye[1, 32], SKY) for eye in before) == 5
        choices = still(session)
        assert (step(session, choices).observation["eye"] == before).mean() > 0.95
        choices[:, 1] = FAST_LEFT
        turned = step(session, choices).observation["eye"]
        assert ((turned != before).reshape(6, -1).mean(axis=1) > 0.01).all()
    finally:
        session.close()


def near(colour: NDArray[Any], expected: tuple[int, int, int]) -> bool:
    return bool(np.abs(np.asarray(colour, float) - expected).max() < 12)
