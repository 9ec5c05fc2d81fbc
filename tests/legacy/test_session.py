"""What a session promises, with games of both bridges in real Godot 3."""

from __future__ import annotations

import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ludus.errors import (
    ActionError,
    EngineCrashed,
    EngineError,
    EngineTimeout,
    GameError,
    SequenceError,
    UsageError,
)
from ludus.legacy.godot_gym_api.messages import State
from ludus.session import Session
from ludus.spec.batch import ActionBatch
from ludus.wire.reset import ResetAction, ResetRequest
from tests.legacy.conftest import (
    Walk,
    begin,
    final_place_of,
    move,
    place_of,
    step,
    walk_of,
)
from tests.legacy.gymgodot.conftest import left_processes, running_game, started_processes

pytestmark = [pytest.mark.engine, pytest.mark.usefixtures("nothing_left")]


def test_episodes_begin_anew_in_the_step_that_ends_them(session: Session) -> None:
    assert place_of(begin(session, seed=1)) == 0.0
    for _ in range(2):
        for count in range(1, 7):
            batch = step(session, 0.25)
            assert place_of(batch) == 0.5 * count
            assert batch.reward.tolist() == [0.25 * count]
            assert not batch.terminated.any()
            assert batch.final_index.tolist() == []
            assert batch.active.all()
        batch = step(session, 0.25)
        assert (batch.terminated.tolist(), batch.truncated.tolist()) == ([True], [False])
        assert batch.reward.tolist() == [1.75]
        assert (final_place_of(batch), place_of(batch)) == (3.5, 0.0)
        assert batch.final_index.tolist() == [0]
        assert batch.active.all()


def test_the_spec_is_what_was_declared(session: Session) -> None:
    (policy,) = session.spec.policies
    assert (session.spec.num_worlds, policy.name, policy.num_agents) == (1, "agent", 1)
    assert (policy.episode, policy.max_episode_steps) == ("agent", None)
    assert policy.continuous_size == 1
    assert [(entry.name, entry.dtype) for entry in policy.observation] == [
        ("observation", "float32")
    ]


def test_max_episode_steps_truncates(walk: Walk) -> None:
    session = walk.session(max_episode_steps=3)
    assert session.spec.policies[0].max_episode_steps == 3
    begin(session)
    for _ in range(2):
        assert not step(session, 0.25).truncated.any()
        assert not step(session, 0.25).truncated.any()
        batch = step(session, 0.25)
        assert (batch.terminated.tolist(), batch.truncated.tolist()) == ([False], [True])
        assert (final_place_of(batch), place_of(batch)) == (1.5, 0.0)
    session.close()


def test_an_end_at_the_limit_is_no_truncation(walk: Walk) -> None:
    session = walk.session(max_episode_steps=7)
    begin(session)
    for _ in range(6):
        step(session, 0.25)
    batch = step(session, 0.25)
    assert (batch.terminated.tolist(), batch.truncated.tolist()) == ([True], [False])
    session.close()


def test_reset_in_the_middle_begins_an_episode(session: Session) -> None:
    begin(session)
    step(session, 0.25)
    assert place_of(begin(session)) == 0.0
    batch = step(session, 0.5)
    assert place_of(batch) == 1.0
    left = ResetRequest(np.zeros(1, np.uint64), np.array([ResetAction.LEAVE], np.uint8))
    batch = session.reset(left)["agent"]
    assert (place_of(batch), batch.reward.tolist()) == (1.0, [0.0])
    assert place_of(step(session, 0.5)) == 2.0


def test_times_are_measured(session: Session) -> None:
    begin(session)
    for count in range(1, 4):
        step(session, 0.25)
        tick, engine_us, bridge_us, wait_us = session.times
        assert tick == count
        assert engine_us > 0
        assert bridge_us > 0
        assert wait_us >= 0


def test_calls_out_of_turn_are_refused(session: Session) -> None:
    with pytest.raises(SequenceError, match="before the first reset"):
        session.send(move(0.0))
    with pytest.raises(SequenceError, match="nothing to receive"):
        session.receive()
    left = ResetRequest(np.zeros(1, np.uint64), np.array([ResetAction.LEAVE], np.uint8))
    with pytest.raises(SequenceError, match="the first reset left the world out"):
        session.reset(left)
    begin(session)
    session.send(move(0.25))
    for forbidden in (lambda: session.send(move(0.0)), lambda: begin(session)):
        with pytest.raises(SequenceError, match="during a step"):
            forbidden()
    with pytest.raises(SequenceError, match="during a step"):
        session.call({"world": 0}, "anything")
    assert place_of(session.receive()["agent"]) == 0.5
    with pytest.raises(SequenceError, match="nothing to receive"):
        session.receive()


def test_bad_actions_do_no_harm(session: Session) -> None:
    begin(session)
    with pytest.raises(ActionError, match="no actions for policy agent"):
        session.send({})
    with pytest.raises(ActionError, match=r"agent.continuous: expected .*\(1, 1\), got \(1, 2\)"):
        session.send({"agent": ActionBatch(np.zeros((1, 0), "i8"), np.zeros((1, 2), "f4"))})
    wrong = ActionBatch(np.zeros((1, 1), np.int64), np.zeros((1, 1), np.float32))
    with pytest.raises(ActionError, match=r"agent.discrete: expected .*\(1, 0\), got \(1, 1\)"):
        session.send({"agent": wrong})
    with pytest.raises(ActionError, match="nan"):
        session.send(move(np.nan))
    assert place_of(step(session, 0.25)) == 0.5


def test_requests_for_several_worlds_are_refused(session: Session) -> None:
    with pytest.raises(UsageError, match="reset of 2 worlds, the game has 1"):
        session.reset(ResetRequest.all_worlds(2, 0))
    with pytest.raises(UsageError, match="parameters for 2 worlds"):
        begin(session, parameters=[{}, {}])
    with pytest.raises(UsageError, match="unknown reset option"):
        begin(session, parameters={"wind": 1.0})
    assert place_of(begin(session)) == 0.0


def test_session_has_no_requests(session: Session) -> None:
    begin(session)
    assert (session.has_requests, session.take_requests()) == (False, [])
    session.show_status({"agent_steps": 0, "updates": 0, "policies": {}})
    with pytest.raises(GameError, match="has no such method"):
        session.call({"bridge": True}, "run_ceiling", [10, 0])
    assert place_of(step(session, 0.25)) == 0.5


def test_close_ends_the_game(session: Session) -> None:
    begin(session)
    assert started_processes() != []
    session.close()
    assert left_processes() == []
    session.close()
    with pytest.raises(SequenceError, match="after the end of the session"):
        begin(session)


def test_a_game_that_is_killed_in_a_step(session: Session) -> None:
    begin(session)
    game = running_game()
    game.send_signal(signal.SIGSTOP)
    session.send(move(0.25))
    game.kill()
    with pytest.raises(EngineCrashed, match="Godot Engine v3"):
        session.receive()
    assert left_processes() == []
    with pytest.raises(SequenceError, match="after the end of the session"):
        begin(session)


NO_NUMBER = r"observation.* does not fit observation_space: nan at \[0\]"


@pytest.mark.parametrize(
    ("kind", "fault", "error", "what"),
    [
        ("gymgodot", "nan", GameError, NO_NUMBER),
        ("json", "nan", GameError, NO_NUMBER),
        ("gymgodot", "hang", EngineTimeout, "did not answer .*step.* within 4 s"),
        ("protobuf", "hang", EngineTimeout, "did not answer .*action.* within 4 s"),
        ("gymgodot", "quit", EngineCrashed, "exit code 9"),
        ("json", "quit", EngineCrashed, "exit code 9"),
    ],
)
def test_faults_raise_their_error(
    projects: dict[str, Path],
    monkeypatch: pytest.MonkeyPatch,
    kind: str,
    fault: str,
    error: type[EngineError],
    what: str,
) -> None:
    monkeypatch.setenv("WALK_FAULT", fault)
    session = walk_of(kind, projects).session(step_timeout_s=4.0)
    with pytest.raises(error, match=what):
        begin(session)
        for _ in range(8):
            step(session, 0.0)
    assert left_processes() == []
    session.close()


def too_much(_: State) -> float:
    return 1e39


@pytest.mark.filterwarnings("ignore:overflow encountered")
def test_infinite_reward_is_an_error(projects: dict[str, Path]) -> None:
    """The session looks, too: finite is what float32 holds."""
    session = walk_of("json", projects).session(get_reward=too_much)
    begin(session)
    with pytest.raises(GameError, match="agent: world 0, agent 0: reward is inf at step 1"):
        step(session, 0.0)
    assert left_processes() == []


def call(session: Session, method: str, *arguments: Any) -> Any:
    return session.call({"world": 0}, method, arguments)


@pytest.mark.parametrize("kind", ["json", "protobuf"])
def test_methods_of_godot_gym_api(projects: dict[str, Path], kind: str) -> None:
    session = walk_of(kind, projects).session()
    begin(session)
    assert call(session, "set_repeat_action", 6) is None
    assert place_of(step(session, 0.25)) == 1.5
    call(session, "set_time_speed", 2.0)
    call(session, "configure", {"environment": {"repeat_action": 1}, "agent": {"scale": 2.0}})
    assert place_of(step(session, 0.25)) == 2.0
    assert place_of(begin(session, parameters={"world": {"start": 0.5}})) == 0.5
    assert place_of(begin(session)) == 0.5
    with pytest.raises(UsageError, match="arguments of set_repeat_action do not fit"):
        call(session, "set_repeat_action")
    with pytest.raises(GameError, match="has no such method") as caught:
        call(session, "fly")
    assert "configure, set_repeat_action, set_time_speed" in caught.value.hint
    assert place_of(step(session, 0.25)) == 1.0
    session.close()
