"""Several agents in one game: who ends first waits until all have ended."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pytest
from gymnasium import spaces

from ludus.errors import ActionError, ConfigError, GameError, ProtocolError, TargetError
from ludus.legacy.game import Declaration, LegacyGame, Outcome
from ludus.legacy.session import LegacySession
from ludus.spec.batch import ActionBatch, Batch
from ludus.wire.reset import ResetRequest

LIVES = (2, 4, 3)


class Countdown(LegacyGame):
    """A game in Python: agent *i* sees its step, and ends in step ``LIVES[i]``."""

    def __init__(self, **changes: Any) -> None:
        declared: dict[str, Any] = {
            "name": "countdown",
            "observation_space": spaces.Dict(
                {"step": spaces.Box(0.0, 9.0, (1,)), "agent": spaces.Box(0, 9, (2,), np.int64)}
            ),
            "action_space": spaces.MultiDiscrete([2, 3], start=[1, 0]),
            "num_agents": len(LIVES),
        }
        super().__init__(Declaration(**{**declared, **changes}))
        self.answers = len(LIVES)
        self.seen: list[Sequence[Any]] = []
        self.resets: list[tuple[int | None, Mapping[str, Any] | None]] = []
        self.closings = 0
        self._step = 0

    def reset(self, seed: int | None, parameters: Mapping[str, Any] | None) -> Sequence[Any]:
        self.resets.append((seed, parameters))
        self._step = 0
        return self._observations()

    def send(self, actions: Sequence[Any]) -> None:
        self.seen.append(actions)

    def receive(self) -> Outcome:
        self._step += 1
        ended = [self._step >= lives for lives in LIVES]
        return Outcome(self._observations(), [1.0, 2.0, 3.0], ended, [False] * len(LIVES))

    def close(self) -> None:
        self.closings += 1

    def _observations(self) -> list[Any]:
        found = [{"step": [self._step], "agent": [i, self._step]} for i in range(len(LIVES))]
        return found[: self.answers]


def opened(max_episode_steps: int | None = None, **changes: Any) -> tuple[Countdown, Any]:
    game = Countdown(**changes)
    return game, LegacySession(game, max_episode_steps)


def begin(session: LegacySession) -> Batch:
    return session.reset(ResetRequest.all_worlds(1, 7, {"size": 2}))["agent"]


def step(session: LegacySession) -> Batch:
    actions = np.array([[0, 0], [1, 1], [0, 2]])
    session.send({"agent": ActionBatch(actions, np.zeros((3, 0), np.float32))})
    return session.receive()["agent"]


def test_agent_that_ends_early_waits() -> None:
    game, session = opened()
    (policy,) = session.spec.policies
    assert (policy.episode, policy.agents_per_world, policy.nvec) == ("world", 3, (2, 3))
    assert begin(session).active.all()
    step(session)
    batch = step(session)
    assert batch.reward.tolist() == [1.0, 2.0, 3.0]
    assert batch.terminated.tolist() == [True, False, False]
    assert batch.active.tolist() == [False, True, True]
    assert batch.observation["step"].tolist() == [[0.0], [2.0], [2.0]]
    assert batch.final_index.tolist() == [0]
    assert batch.final_observation["agent"].tolist() == [[0, 2]]
    batch = step(session)
    assert batch.reward.tolist() == [0.0, 2.0, 3.0]
    assert batch.terminated.tolist() == [False, False, True]
    assert batch.active.tolist() == [False, True, False]
    assert batch.final_index.tolist() == [2]
    assert game.resets == [(7, {"size": 2})]
    batch = step(session)
    assert batch.terminated.tolist() == [False, True, False]
    assert batch.final_observation["step"].tolist() == [[4.0]]
    assert batch.active.all()
    assert batch.observation["agent"].tolist() == [[0, 0], [1, 0], [2, 0]]
    assert game.resets == [(7, {"size": 2}), (None, None)]
    assert step(session).reward.tolist() == [1.0, 2.0, 3.0]


def test_waiting_agents_send_no_actions() -> None:
    game, session = opened()
    begin(session)
    for _ in range(4):
        step(session)
    sent = [[None if a is None else a.tolist() for a in actions] for actions in game.seen]
    assert sent[0] == sent[1] == [[1, 0], [2, 1], [1, 2]]
    assert sent[2] == [None, [2, 1], [1, 2]]
    assert sent[3] == [None, [2, 1], None]


def test_truncation_ends_all_at_once() -> None:
    game, session = opened(max_episode_steps=2)
    begin(session)
    assert not step(session).final_index.size
    batch = step(session)
    assert batch.terminated.tolist() == [True, False, False]
    assert batch.truncated.tolist() == [False, True, True]
    assert batch.final_index.tolist() == [0, 1, 2]
    assert batch.active.all()
    assert len(game.resets) == 2


def test_wrong_number_of_agents_is_refused() -> None:
    game, session = opened()
    begin(session)
    game.answers = 2
    with pytest.raises(ProtocolError, match="answered for 2 agents, expected 3"):
        step(session)
    assert game.closings == 1


def test_misfitting_observation_closes_the_game() -> None:
    space = spaces.Dict({"step": spaces.Box(0.0, 9.0, (3,)), "agent": spaces.Box(0, 9, (2,))})
    game, session = opened(observation_space=space)
    with pytest.raises(GameError, match="observation of agent 0 does not fit"):
        begin(session)
    assert game.closings == 1


def test_untrainable_spaces_are_refused() -> None:
    for changes, error in (
        ({"num_agents": 0}, ConfigError),
        ({"observation_space": spaces.Discrete(3)}, TargetError),
        ({"action_space": spaces.Box(-np.inf, np.inf, (1,))}, TargetError),
    ):
        game = Countdown(**changes)
        with pytest.raises(error):
            LegacySession(game)
        assert game.closings == 1


def test_multi_binary_is_choices_of_two() -> None:
    game, session = opened(action_space=spaces.MultiBinary(2))
    assert session.spec.policies[0].nvec == (2, 2)
    begin(session)
    actions = np.array([[0, 1], [1, 1], [1, 0]])
    session.send({"agent": ActionBatch(actions, np.zeros((3, 0), np.float32))})
    assert [action.tolist() for action in game.seen[0]] == actions.tolist()
    assert game.seen[0][0].dtype == np.int8
    session.receive()
    with pytest.raises(ActionError, match="expected actions of shape"):
        session.send({"agent": ActionBatch(actions[:2], np.zeros((3, 0), np.float32))})
