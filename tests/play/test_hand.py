"""What a game says a person does, as an action; without an engine."""

from __future__ import annotations

import re
from typing import Any, cast

import numpy as np
import pytest

from ludus.errors import ActionError
from ludus.play.hand import hand_player
from ludus.pool import EnginePool
from ludus.spec import AgentSpec, ContinuousAction, DiscreteAction, ObservationEntry, PolicySpec
from ludus.spec.batch import ActionBatch, Batch

MOVE, JUMP = DiscreteAction("move", 3), DiscreteAction("jump", 2)
AIM, PUSH = ContinuousAction("aim", 2), ContinuousAction("push", 1)
Action = tuple[DiscreteAction | ContinuousAction, ...]


class SayingGame:
    """A pool of one agent, whose ``get_manual_action()`` always returns the same."""

    def __init__(self, action: Action, said: Any) -> None:
        entry = ObservationEntry("x", "float32", (1,))
        self.policies = {"hero": PolicySpec("hero", (entry,), action, (AgentSpec(0, "Hero"),))}
        self._said = said

    def num_agents(self, policy: str) -> int:
        """Return how many there are."""
        return len(self.policies[policy].agents)

    def call(self, target: dict[str, Any], method: str) -> list[Any]:
        """Answer the only question."""
        assert target == {"world": 0, "agent": "Hero"}
        assert method == "get_manual_action"
        return [self._said]


def play(action: Action, said: Any) -> ActionBatch:
    """Return what a person's player does in a game that says ``said``."""
    game = SayingGame(action, said)
    batch = Batch.allocate(game.policies["hero"], 1)
    batch.active[:] = True
    return hand_player(cast(EnginePool, game))({"hero": batch})["hero"]


@pytest.mark.parametrize(
    ("action", "said", "choices", "numbers"),
    [
        ((MOVE,), 2, [2], []),
        ((MOVE,), {"move": 2}, [2], []),
        ((JUMP,), True, [1], []),
        ((MOVE, JUMP), [2, 1], [2, 1], []),
        ((MOVE, JUMP), {"jump": 1, "move": 2}, [2, 1], []),
        ((PUSH,), 0.5, [], [0.5]),
        ((AIM, PUSH), [0.5, -1, 0.25], [], [0.5, -1, 0.25]),
        ((AIM, PUSH), {"push": 0.25, "aim": [0.5, -1]}, [], [0.5, -1, 0.25]),
        ((AIM, MOVE, PUSH), {"move": 2, "aim": [0.5, -1], "push": [0.25]}, [2], [0.5, -1, 0.25]),
    ],
    ids=str,
)
def test_numbers_lists_and_dictionaries_are_actions(
    action: Action, said: Any, choices: list[int], numbers: list[float]
) -> None:
    played = play(action, said)
    assert played.discrete.tolist() == [choices]
    assert np.array_equal(played.continuous, np.array([numbers], np.float32))


@pytest.mark.parametrize(
    ("action", "said", "message"),
    [
        ((MOVE,), 7, "move is 7, expected 0 to 2"),
        ((MOVE, JUMP), {"move": 2, "jump": -1}, "jump is -1, expected 0 to 1"),
        ((MOVE, JUMP), 1, "expected 2 numbers for move, jump, got 1"),
        ((MOVE, JUMP), [2, 1, 0], "expected 2 numbers for move, jump, got 3"),
        ((MOVE, JUMP), {"move": 2}, "it lacks jump"),
        ((AIM,), 0.5, "expected 2 numbers for aim, got 1"),
        ((MOVE, AIM), {"move": 2, "aim": 0.5}, "aim has 1 numbers, expected 2"),
        ((MOVE, AIM), {"move": 2}, "it lacks aim"),
        ((MOVE, AIM), [2, 0.5, 0.1], "expected a dictionary of move, aim"),
        ((MOVE,), "left", "invalid literal for int() with base 10: 'left'"),
        ((MOVE, AIM), {"move": None, "aim": [0.5, 0.1]}, "int() argument must be"),
    ],
    ids=str,
)
def test_something_else_is_an_error(action: Action, said: Any, message: str) -> None:
    start = f"get_manual_action() of policy hero returned {said!r}, which is not an action: "
    with pytest.raises(ActionError, match=re.escape(start + message)):
        play(action, said)
