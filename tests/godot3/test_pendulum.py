"""Pendulum obeys the equation of a rod on a hinge."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

from ludus.session import EngineSession, open_session
from ludus.spec.batch import ActionBatch
from ludus.wire.handshake import EngineConfig
from ludus.wire.reset import ResetRequest
from tests.targets import find_game

pytestmark = pytest.mark.engine

NUM_WORLDS = 4
STEP_S = 0.05
MAX_TORQUE = 2.0
SPEED_SCALE = 8.0
# A box of 0.1 × 1 m and 1 kg, around its end, kg m².
INERTIA = (1.0**2 + 0.1**2) / 12.0 + 0.5**2


@pytest.fixture
def session() -> Iterator[EngineSession]:
    made = open_session(find_game("godot3:pendulum"), EngineConfig(num_worlds=NUM_WORLDS))
    yield made
    made.close()


def accelerations(
    session: EngineSession, gravity: float, action: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return sines of the angle and angular accelerations (rad/s²) of the first step."""
    request = ResetRequest.all_worlds(NUM_WORLDS, 1, {"gravity": gravity})
    before = session.reset(request)["pendulum"].observation["observation"].astype(np.float64)
    torques = np.full((NUM_WORLDS, 1), action, np.float32)
    session.send({"pendulum": ActionBatch(np.zeros((NUM_WORLDS, 0), np.int64), torques)})
    after = session.receive()["pendulum"].observation["observation"].astype(np.float64)
    sines = (before[:, 1] + after[:, 1]) / 2
    return sines, (after[:, 2] - before[:, 2]) * SPEED_SCALE / STEP_S


@pytest.mark.parametrize("action", [-1.0, 0.0, 0.5, 1.0])
def test_the_motor_turns_it(session: EngineSession, action: float) -> None:
    _, acceleration = accelerations(session, 0.0, action)
    assert acceleration == pytest.approx(action * MAX_TORQUE / INERTIA, rel=0.01, abs=0.01)


def test_gravity_pulls_it(session: EngineSession) -> None:
    sines, acceleration = accelerations(session, 10.0, 0.0)
    assert acceleration == pytest.approx(10.0 * 0.5 / INERTIA * sines, rel=0.05, abs=0.1)
    _, still = accelerations(session, 0.0, 0.0)
    assert np.abs(acceleration).max() > 1.0 > np.abs(still).max()
