"""CartPole is the very scene of GymGodot: the same numbers, five steps of "left" from upright."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from ludus.session import EngineSession, open_session
from ludus.spec.batch import ActionBatch
from ludus.wire.handshake import EngineConfig
from ludus.wire.reset import ResetRequest
from tests.targets import find_game

pytestmark = pytest.mark.engine

# Position and angle, from the output of GymGodot's notebook (Godot 3.4).
NOTEBOOK = [
    (0.0, 0.0),
    (-0.088484, 0.010983),
    (-0.294668, 0.036597),
    (-0.618337, 0.076923),
    (-1.059165, 0.132096),
]
# Position, its change, angle and its change at step 5, when GymGodot itself runs in Godot 3.6.2.
GYMGODOT_STEP_5 = (-1.057811, -0.440057, 0.131532, 0.054847)
UPRIGHT = {"start_offset": 0.0, "start_angle": 0.0}
LAYOUTS = ("isolated", "grid")


@pytest.fixture(params=LAYOUTS)
def session(request: pytest.FixtureRequest) -> Iterator[EngineSession]:
    config = EngineConfig(num_worlds=3, layout=request.param)
    made = open_session(find_game("godot3:cartpole"), config)
    yield made
    made.close()


def states_of(session: EngineSession, world: int) -> list[tuple[float, float]]:
    """Return position and angle before each of five steps to the left.

    What GymGodot observes after a step is what was before it.
    """
    actions = {name: ActionBatch.zeros(spec, 3) for name, spec in session.policies.items()}
    states: list[tuple[float, float]] = []
    for _ in NOTEBOOK:
        position, angle = session.call({"world": world}, "get_state")
        states.append((position, angle))
        session.send(actions)
        session.receive()
    return states


@pytest.mark.parametrize("seed", [0, None], ids=["first episode", "second episode"])
def test_five_steps_to_the_left(session: EngineSession, seed: int | None) -> None:
    session.reset(ResetRequest.all_worlds(3, 0, UPRIGHT))
    if seed is None:
        states_of(session, 0)
        session.reset(ResetRequest.all_worlds(3, None))
    states = states_of(session, 2)
    changes = [states[4][i] - states[3][i] for i in (0, 1)]
    step_5 = (states[4][0], changes[0], states[4][1], changes[1])
    assert step_5 == pytest.approx(GYMGODOT_STEP_5, abs=1e-4)
    for state, expected in zip(states, NOTEBOOK, strict=True):
        assert state == pytest.approx(expected, rel=0.005, abs=1e-6)
