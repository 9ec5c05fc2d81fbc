"""Worlds of Godot 3 apart, with the physics of Bullet."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from ludus.errors import TargetError
from ludus.session import EngineSession
from ludus.spec.batch import ActionBatch
from ludus.wire.reset import ResetRequest
from tests.godot.conftest import Game, reset

pytestmark = pytest.mark.engine


def play(session: EngineSession, num_steps: int, first_world: int = 0) -> NDArray[np.float32]:
    """Push the balls of each world at random, world *i* always in the same way.

    Returns:
        What was observed, ``float32[num_steps, num_worlds, 3]``.
    """
    num_worlds = session.spec.num_worlds
    session.reset(ResetRequest.all_worlds(num_worlds, 5 + first_world))
    streams = [np.random.default_rng(first_world + world) for world in range(num_worlds)]
    frames: list[NDArray[np.float32]] = []
    for _ in range(num_steps):
        push = np.array([[stream.uniform(-1, 1)] for stream in streams], np.float32)
        session.send({"agent": ActionBatch(np.zeros((num_worlds, 0), np.int64), push)})
        frames.append(session.receive()["agent"].observation["observation"].copy())
    return np.stack(frames)


@pytest.mark.parametrize("scene", ["balls", "settling"])
def test_worlds_are_isolated_and_equal_to_worlds_alone(game: Game, scene: str) -> None:
    together = play(game.open(scene, num_worlds=3), 60)
    assert len(np.unique(together[-1, :, 0])) == 3, "all worlds do the same"
    for world in range(3):
        alone = play(game.open(scene), 60, world)
        assert np.array_equal(together[:, world], alone[:, 0])


def test_equal_seeds_are_equal_bits_whatever_was_before(game: Game) -> None:
    session = game.open("balls", num_worlds=2)
    first = play(session, 60)
    again = play(session, 60)
    assert np.array_equal(first, again)
    other = play(session, 60, 9)
    assert not np.array_equal(first, other)


def test_settling_lets_the_ball_fall_first(game: Game) -> None:
    fallen = reset(game.open("settling"))["agent"].observation["observation"][0, 1]
    hanging = reset(game.open("balls"))["agent"].observation["observation"][0, 1]
    assert hanging == 2.0
    assert fallen < 1.0 + 1.0 + 1e-3 and fallen != hanging


def test_more_worlds_than_bullet_can_keep_are_refused(game: Game) -> None:
    with pytest.raises(TargetError, match="Bullet can keep 126"):
        game.open("balls", num_worlds=127)
