"""Pixels over bevy_rl's REST interface, from a real program that draws in software."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any, cast

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.utils.env_checker import check_env
from numpy.typing import NDArray

import ludus
from ludus.engine.bevy_build import build_bevy_example
from ludus.errors import GameError
from ludus.legacy.bevy_rl import game as game_module
from ludus.legacy.session import LegacySession
from ludus.spec.batch import Batch
from tests.legacy.bevy_rl.program import Program, Start, reset, step

pytestmark = [pytest.mark.engine, pytest.mark.bevy, pytest.mark.timeout(300, func_only=True)]

LEFT, RIGHT = 0, 1
NUM_TILES = 10
_WHITE = (255, 255, 255)

Pixels = NDArray[np.uint8]
Walker = tuple[int, int]
"""The tile of an agent, and its goal."""


@pytest.fixture(scope="session")
def tiles_executable() -> Path:
    """The example, built; a machine without Cargo fails these tests."""
    return build_bevy_example("rest_tiles")


@pytest.fixture(params=["ludus", "bevy_rl"])
def arguments(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """In lock-step with our own requests, and in real time with those that bevy_rl knows."""
    if request.param == "ludus":
        return []
    monkeypatch.setattr(game_module, "_OURS", "nobody/")
    return ["--pause-interval=0.0001"]


@pytest.fixture
def start(tiles_executable: Path) -> Iterator[Start]:
    """Starts programs at free ports: ``start(num_agents, width, height, *arguments)``."""
    programs: list[Program] = []

    def start_one(num_agents: int, width: int, height: int, *arguments: str) -> Program:
        sizes = (f"--agents={num_agents}", f"--width={width}", f"--height={height}")
        defaults = {
            "action_space": spaces.Discrete(2),
            "observation_space": _space(width, height),
            "with_pixels": True,
        }
        program = Program(tiles_executable, "--port=0", *sizes, *arguments, defaults=defaults)
        programs.append(program)
        return program

    yield start_one
    for program in programs:
        program.close()


def _image(width: int, height: int, channels: int = 3) -> spaces.Box:
    return spaces.Box(0, 255, (height, width, channels), np.uint8)


def _space(width: int, height: int, channels: int = 3) -> spaces.Dict:
    place = spaces.Box(0, NUM_TILES - 1, (1,), np.float32)
    return spaces.Dict({"pixels": _image(width, height, channels), "tile": place, "goal": place})


def _picture(agent: int, walker: Walker, width: int, height: int) -> Pixels:
    """Return what an agent must see, as looks.rs of the example says."""
    place, goal = walker
    green = 40 + 50 * agent
    picture = np.empty((height, width, 3), np.uint8)
    picture[:] = (0, green, 60)
    is_ground = (np.arange(height) + 0.5) * 3 / height > 2
    tiles = place - 1 + ((np.arange(width) + 0.5) * 3 / width).astype(int)
    for column, tile in enumerate(tiles):
        if 0 <= tile < NUM_TILES:
            colour = _WHITE if tile == goal else (20 + 20 * tile, green, 200)
            picture[is_ground, column] = colour
    return picture


def _assert_seen(pixels: Pixels, agent: int, walker: Walker) -> None:
    height, width, _ = pixels.shape
    # Colours are rounded twice on their way through the renderer.
    np.testing.assert_allclose(
        pixels.astype(int), _picture(agent, walker, width, height).astype(int), atol=1
    )


def _walkers(observation: dict[str, NDArray[Any]]) -> list[Walker]:
    places, goals = observation["tile"][:, 0], observation["goal"][:, 0]
    return [(int(place), int(goal)) for place, goal in zip(places, goals, strict=True)]


def _assert_all_seen(batch: Batch) -> list[Walker]:
    """Check the pictures of all agents against the state that came with them."""
    walkers = _walkers(batch.observation)
    for agent, walker in enumerate(walkers):
        _assert_seen(batch.observation["pixels"][agent], agent, walker)
    return walkers


def _moved(walker: Walker, choice: int) -> Walker:
    place, goal = walker
    return min(max(place + (1 if choice == RIGHT else -1), 0), NUM_TILES - 1), goal


def _away(walker: Walker) -> int:
    """Return the choice that does not lead to the goal."""
    place, goal = walker
    return LEFT if goal > place else RIGHT


@pytest.mark.parametrize(
    ("num_agents", "width", "height"),
    [(1, 36, 24), (2, 20, 7), (4, 7, 31), (3, 65, 2), (2, 300, 90)],
)
def test_each_agent_sees_its_own_tiles(
    start: Start, num_agents: int, width: int, height: int
) -> None:
    session = start(num_agents, width, height).open()
    assert session.spec.policies[0].num_agents == num_agents
    batch = reset(session)
    pixels = batch.observation["pixels"]
    assert pixels.shape == (num_agents, height, width, 3)
    assert pixels.dtype == np.uint8
    _assert_all_seen(batch)


def test_pictures_show_the_state_after_the_step(start: Start, arguments: list[str]) -> None:
    session = start(3, 30, 12, *arguments).open()
    expected = _walkers(reset(session).observation)
    for _ in range(4):
        choices = [_away(walker) for walker in expected]
        expected = [_moved(*pair) for pair in zip(expected, choices, strict=True)]
        assert _assert_all_seen(step(session, *choices)) == expected


def test_pictures_show_the_first_state_after_a_reset(start: Start, arguments: list[str]) -> None:
    session = start(2, 30, 12, *arguments).open()
    seen: set[tuple[Walker, ...]] = set()
    for _ in range(4):
        walkers = _assert_all_seen(reset(session))
        seen.add(tuple(walkers))
        step(session, *(_away(walker) for walker in walkers))
    assert len(seen) > 1, "episodes begin elsewhere"


def test_who_arrives_sees_the_goal_and_then_the_next_episode(
    start: Start, arguments: list[str]
) -> None:
    session = start(1, 30, 12, *arguments).open()
    walker = _walkers(reset(session).observation)[0]
    batch = _walk_to_goal(session, walker)
    final = batch.final_observation
    assert final["tile"][0, 0] == final["goal"][0, 0] == walker[1]
    _assert_seen(final["pixels"][0], 0, (walker[1], walker[1]))
    assert batch.reward[0] == 1.0
    begun = _assert_all_seen(batch)[0]
    assert begun[0] != begun[1]


def _walk_to_goal(session: LegacySession, walker: Walker) -> Batch:
    for _ in range(NUM_TILES):
        batch = step(session, RIGHT - _away(walker))
        if batch.terminated[0]:
            return batch
        walker = _assert_all_seen(batch)[0]
    raise AssertionError("the goal is not on the way")


@pytest.mark.parametrize("channels", [1, 4])
def test_pixels_have_the_channels_of_the_space(start: Start, channels: int) -> None:
    session = start(2, 20, 9).open(observation_space=_space(20, 9, channels))
    observation = reset(session).observation
    assert observation["pixels"].shape == (2, 9, 20, channels)
    for agent, walker in enumerate(_walkers(observation)):
        expected = _picture(agent, walker, 20, 9).astype(float)
        if channels == 1:
            # As Pillow makes colours grey.
            expected = expected @ np.array([[0.299], [0.587], [0.114]])
        seen = observation["pixels"][agent].astype(float)
        np.testing.assert_allclose(seen[..., :3], expected, atol=2)
        assert channels == 1 or (seen[..., 3] == 255).all()


def test_a_space_of_another_size_is_refused(start: Start) -> None:
    session = start(2, 20, 9).open(observation_space=_image(9, 20))
    with pytest.raises(GameError, match="the picture has 40 x 9 pixels, expected 18 x 20"):
        reset(session)


def test_gymnasium_checker_passes(start: Start) -> None:
    # It warns of smaller ones.
    program = start(1, 48, 36)
    make = partial(
        ludus.make,
        program.url,
        action_space=spaces.Discrete(2),
        observation_space=_image(48, 36),
        with_pixels=True,
    )
    # Seeds have no effect.
    cast("Any", gymnasium).register("ludus-test/RestTiles-v0", make, nondeterministic=True)
    try:
        with gymnasium.make("ludus-test/RestTiles-v0", max_episode_steps=20) as env:
            check_env(env.unwrapped, skip_render_check=True)
    finally:
        del gymnasium.registry["ludus-test/RestTiles-v0"]


def test_all_agents_at_once(start: Start) -> None:
    program = start(3, 30, 12)
    envs = ludus.make_vec(
        program.url,
        action_space=spaces.Discrete(2),
        observation_space=_space(30, 12),
        with_pixels=True,
        max_episode_steps=3,
    )
    assert envs.num_envs == 3
    observations, _ = envs.reset(seed=7)
    walkers = _walkers(observations)
    choices = [_away(walker) for walker in walkers]
    observations, *_ = envs.step(np.array(choices))
    walkers = [_moved(*pair) for pair in zip(walkers, choices, strict=True)]
    assert _walkers(observations) == walkers
    for agent, walker in enumerate(walkers):
        _assert_seen(observations["pixels"][agent], agent, walker)
    envs.close()
