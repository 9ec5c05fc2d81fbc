"""Actions of every kind: what fits reaches the wire, what does not is refused with a reason."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from gymnasium import spaces

from ludus.errors import ActionError
from ludus.spec import (
    ActionComponent,
    AgentSpec,
    ContinuousAction,
    DiscreteAction,
    ObservationEntry,
    PolicySpec,
)
from ludus.spec.spaces import action_space, observation_space, to_action_batch

TURN = DiscreteAction("turn", 3)
JUMP = DiscreteAction("jump", 2)
FORCE = ContinuousAction("force", 2, low=(-1.0, -2.0), high=(1.0, 2.0))


def policy(*parts: ActionComponent, entries: tuple[ObservationEntry, ...] = ()) -> PolicySpec:
    own = entries or (ObservationEntry("observation", "float32", (2,)),)
    return PolicySpec("hero", own, parts, (AgentSpec(0, "A"), AgentSpec(1, "A")))


def test_spaces_follow_the_components() -> None:
    assert action_space(policy(TURN)) == spaces.Discrete(3)
    assert action_space(policy(TURN, JUMP)) == spaces.MultiDiscrete([3, 2])
    box: Any = action_space(policy(FORCE))
    assert type(box) is spaces.Box
    np.testing.assert_array_equal(box.high, [1, 2])
    mixed: Any = action_space(policy(TURN, FORCE))
    assert set(mixed) == {"turn", "force"}


def test_observation_space_is_a_box_for_the_one_entry_called_observation() -> None:
    named = ObservationEntry("rays", "float32", (3,), 0.0, 1.0)
    image = ObservationEntry("camera", "uint8", (4, 4, 3))
    assert isinstance(observation_space(policy(TURN)), spaces.Box)
    space: Any = observation_space(policy(TURN, entries=(named, image)))
    assert type(space) is spaces.Dict
    assert space["camera"].dtype == np.uint8
    assert space["rays"].shape == (3,)


FITTING: list[tuple[Any, ...]] = [
    ((TURN,), [2, 0], [[2], [0]], [[], []]),
    ((TURN,), np.array([1, 1], np.int32), [[1], [1]], [[], []]),
    ((TURN, JUMP), [[2, 1], [0, 0]], [[2, 1], [0, 0]], [[], []]),
    ((FORCE,), [[0.5, -2.0], [0.0, 1.0]], [[], []], [[0.5, -2.0], [0.0, 1.0]]),
    (
        (FORCE, TURN),
        {"turn": [1, 2], "force": [[0.5, 1.0], [0.0, 0.0]]},
        [[1], [2]],
        [[0.5, 1.0], [0.0, 0.0]],
    ),
]


@pytest.mark.parametrize(("parts", "actions", "discrete", "continuous"), FITTING)
def test_fitting_actions_reach_the_wire(
    parts: tuple[ActionComponent, ...], actions: Any, discrete: Any, continuous: Any
) -> None:
    batch = to_action_batch(policy(*parts), actions, 2)
    assert batch.discrete.dtype == np.int64
    assert batch.continuous.dtype == np.float32
    np.testing.assert_array_equal(batch.discrete, discrete)
    np.testing.assert_array_equal(batch.continuous, continuous)


@pytest.mark.parametrize(
    ("parts", "actions", "reason"),
    [
        ((TURN,), [0, 3], "action 3 of agent 1 is out of range 0 to 2"),
        ((TURN,), [-1, 0], "action -1 of agent 0 is out of range"),
        ((TURN,), [0.0, 1.0], "expected whole numbers"),
        ((TURN,), [0], r"action: expected shape \(2,\), got \(1,\)"),
        ((TURN,), [0, 1, 2], r"expected shape \(2,\), got \(3,\)"),
        ((TURN, JUMP), [[0, 2], [0, 0]], "action 2 of agent 0 is out of range 0 to 1"),
        ((TURN, JUMP), [0, 1], r"expected shape \(2, 2\), got \(2,\)"),
        ((FORCE,), [[0.0, np.nan], [0.0, 0.0]], "NaN or infinite"),
        ((FORCE,), [[0.0, np.inf], [0.0, 0.0]], "NaN or infinite"),
        ((FORCE,), [[0.0], [0.0]], r"expected shape \(2, 2\), got \(2, 1\)"),
        ((TURN, FORCE), [[0, 0]], "expected a dictionary"),
        ((TURN, FORCE), {"turn": [0, 0]}, "lacks force"),
        ((TURN, FORCE), {"turn": [0, 3], "force": np.zeros((2, 2))}, "out of range"),
        (
            (TURN, FORCE),
            {"turn": [0, 0], "force": np.zeros((2, 3))},
            r"force: expected shape \(2, 2\)",
        ),
    ],
)
def test_misfits_are_refused_with_a_reason(
    parts: tuple[ActionComponent, ...], actions: Any, reason: str
) -> None:
    with pytest.raises(ActionError, match=reason):
        to_action_batch(policy(*parts), actions, 2)


@pytest.mark.parametrize(
    ("parts", "action", "expected"),
    [((TURN,), [0, 1], r"\(\)"), ((TURN, JUMP), [0], r"\(2,\)"), ((FORCE,), [0.5], r"\(2,\)")],
)
def test_one_action_is_compared_with_the_space_of_one_agent(
    parts: tuple[ActionComponent, ...], action: Any, expected: str
) -> None:
    space = action_space(policy(*parts))
    to_action_batch(policy(*parts), space.sample(), None)
    with pytest.raises(ActionError, match=f"expected shape {expected}, got"):
        to_action_batch(policy(*parts), action, None)
