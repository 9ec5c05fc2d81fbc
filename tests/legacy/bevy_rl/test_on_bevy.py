"""Ludus drives programs with bevy_rl's REST interface: a real one, built by Cargo."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces

import ludus
from ludus.engine.bevy_build import build_bevy_example
from ludus.errors import (
    ConfigError,
    EngineCrashed,
    EngineStartError,
    EngineTimeout,
    GameError,
    ProtocolError,
    UsageError,
)
from ludus.legacy.bevy_rl import game as game_module
from ludus.legacy.session import LegacySession
from ludus.wire.reset import ResetRequest
from tests.legacy.bevy_rl.program import Program, Start, reset, step

pytestmark = [pytest.mark.engine, pytest.mark.bevy, pytest.mark.timeout(300, func_only=True)]

_DEADLINE_S = 20.0
_CART = spaces.Box(-np.inf, np.inf, (4,), np.float32)
_DEFAULTS: dict[str, Any] = {"action_space": spaces.Discrete(2), "observation_space": _CART}


@pytest.fixture(scope="session")
def rest_executable() -> Path:
    """The example, built; a machine without Cargo fails these tests."""
    return build_bevy_example("rest_cartpole")


@pytest.fixture
def start(rest_executable: Path) -> Iterator[Start]:
    """Starts programs at free ports, or at the one that is asked for."""
    programs: list[Program] = []

    def start_one(*arguments: str, port: int = 0) -> Program:
        programs.append(Program(rest_executable, f"--port={port}", *arguments, defaults=_DEFAULTS))
        return programs[-1]

    yield start_one
    for program in programs:
        program.close()


@pytest.fixture
def as_bevy_rl(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lets Python talk as it does to programs made with bevy_rl itself."""
    monkeypatch.setattr(game_module, "_OURS", "nobody/")


def _play(env: gymnasium.Env[Any, Any]) -> tuple[float, int]:
    """Balance the pole for an episode; return the return and the number of steps."""
    observation, _ = env.reset(seed=7)
    total, num_steps, is_over = 0.0, 0, False
    while not is_over:
        push = int(observation[2] + observation[3] > 0)
        observation, reward, terminated, truncated, _ = env.step(np.int64(push))
        total, num_steps, is_over = total + float(reward), num_steps + 1, terminated or truncated
    return total, num_steps


def test_the_pole_is_balanced(start: Start) -> None:
    program = start()
    env = ludus.make(
        program.url,
        action_space=spaces.Discrete(2),
        observation_space=_CART,
        max_episode_steps=250,
    )
    assert _play(env) == (250.0, 250)
    env.close()


@pytest.mark.usefixtures("as_bevy_rl")
def test_the_pole_is_balanced_over_the_wire_of_bevy_rl(start: Start) -> None:
    program = start("--pause-interval=0.0001")
    env = ludus.make(
        program.url + "/",
        action_space=spaces.Discrete(2),
        observation_space=_CART,
        max_episode_steps=250,
    )
    assert _play(env) == (250.0, 250)
    env.close()


def test_actions_have_their_effect_and_episodes_their_ends(start: Start) -> None:
    session = start().open()
    before = reset(session).observation["observation"][0].copy()
    after = step(session, 1).observation["observation"][0]
    assert after[1] > before[1]
    assert after[3] < before[3]
    batches = (step(session, 1) for _ in range(100))
    batch = next(batch for batch in batches if batch.terminated[0])
    # The pole has fallen; the next episode begins upright, in the same step.
    assert abs(batch.final_observation["observation"][0, 2]) > 1.0
    assert abs(batch.observation["observation"][0, 2]) < 0.2
    assert batch.reward[0] == 1.0


def test_a_world_begins_anew_when_all_its_agents_have_ended(start: Start) -> None:
    session = start("--agents=3").open()
    reset(session)
    assert session.spec.policies[0].num_agents == 3
    ended = _step_until_all_have_ended(session, np.zeros(3, bool))
    assert ended == [0, 1, 2]
    # The last one's end has begun the next episode of all.
    assert step(session, 0, 0, 0).active.all()


def _step_until_all_have_ended(session: LegacySession, has_ended: Any) -> list[int]:
    """Push carts until all poles have fallen; return who fell, in order of their numbers."""
    for turn in range(300):
        # One cart is only pushed away, the others are balanced for a while.
        choices = (1, turn % 2, turn % 2) if turn < 20 else (1, 1, 0)
        batch = step(session, *choices)
        assert not (batch.terminated & has_ended).any(), "nobody ends twice"
        has_ended |= batch.terminated
        if has_ended.all():
            return sorted(np.flatnonzero(has_ended).tolist())
        np.testing.assert_array_equal(batch.active, ~has_ended)
    raise AssertionError(f"only {has_ended} have ended")


def _lean(state: Any, agent: int) -> dict[str, Any]:
    return {"lean": np.array([state["agents"][agent][2]], np.float32)}


def _push_or_quit(action: int) -> str:
    return "quit" if action else "0"


def _no_text(action: int) -> Any:
    return action


def test_get_observation_and_to_action_are_the_users_own(start: Start) -> None:
    texts: list[str] = []

    def to_action(action: int) -> str:
        texts.append("1" if action == 0 else "0")
        return texts[-1]

    session = start("--agents=2").open(
        num_agents=2,
        observation_space=spaces.Dict({"lean": spaces.Box(-9, 9, (1,), np.float32)}),
        get_observation=_lean,
        to_action=to_action,
    )
    assert reset(session).observation["lean"].shape == (2, 1)
    lean = step(session, 0, 1).observation["lean"].copy()
    lean_after = step(session, 0, 1).observation["lean"]
    assert texts == ["1", "0", "1", "0"]
    assert lean_after[0] < lean[0]
    assert lean_after[1] > lean[1]


@pytest.mark.parametrize("is_bevy_rl", [False, True])
def test_a_program_that_dies_is_reported(
    start: Start, monkeypatch: pytest.MonkeyPatch, is_bevy_rl: bool
) -> None:
    if is_bevy_rl:
        monkeypatch.setattr(game_module, "_OURS", "nobody/")
    program = start()
    session = program.open()
    reset(session)
    step(session, 1)
    program.process.kill()
    program.process.wait(_DEADLINE_S)
    with pytest.raises(EngineCrashed, match=r"(?s)the program.*start the program again"):
        step(session, 1)


def test_a_program_that_ends_by_itself_is_reported(start: Start) -> None:
    program = start()
    session = program.open(to_action=_push_or_quit)
    reset(session)
    with pytest.raises(EngineCrashed, match="503"):
        step(session, 1)
    assert program.process.wait(_DEADLINE_S) == 0


def test_a_program_that_does_not_answer_is_reported(start: Start) -> None:
    program = start("--pause-interval=1000")
    session = program.open(num_agents=1, step_timeout_s=0.3)
    began = time.monotonic()
    with pytest.raises(EngineTimeout, match=r"did not answer GET .* within 0\.3 s"):
        reset(session)
    assert time.monotonic() - began < _DEADLINE_S / 2
    patient = start("--pause-interval=1000", "--timeout=0.3")
    session = patient.open(num_agents=1)
    with pytest.raises(EngineTimeout, match=r"504: the game did not answer for 0\.3 s"):
        reset(session)


def test_an_address_where_nobody_listens_is_reported(start: Start) -> None:
    program = start()
    program.close()
    with pytest.raises(EngineStartError, match="nobody listens at http://127"):
        program.open(start_timeout_s=0.2)


def test_a_program_that_comes_late_is_waited_for(start: Start) -> None:
    first = start()
    port = int(first.url.rsplit(":", 1)[1])
    first.close()
    late: list[Program] = []
    timer = threading.Timer(0.5, lambda: late.append(start(port=port)))
    timer.start()
    session = first.open(start_timeout_s=_DEADLINE_S)
    timer.join()
    assert reset(session).active.all()


def test_connection_closed_between_requests_is_reopened(start: Start) -> None:
    first = start()
    session = first.open()
    reset(session)
    first.process.kill()
    first.process.wait(_DEADLINE_S)
    start(port=int(first.url.rsplit(":", 1)[1]))
    assert reset(session).active.all()
    assert step(session, 1).reward[0] == 1.0


def test_another_number_of_agents_is_reported(start: Start) -> None:
    session = start("--agents=2").open(num_agents=3)
    with pytest.raises(ProtocolError, match="has 2 agents, expected 3"):
        reset(session)


@pytest.mark.usefixtures("as_bevy_rl")
def test_a_refused_action_is_reported_with_its_reason(start: Start) -> None:
    session = start().open(to_action=_no_text)
    reset(session)
    with pytest.raises(GameError, match=r"(?s)status 400.*not a list of actions"):
        step(session, 1)


def test_a_space_that_does_not_fit_is_reported(start: Start) -> None:
    session = start().open(observation_space=spaces.Box(-1, 1, (5,), np.float32))
    with pytest.raises(GameError, match="the state has 4 numbers, the space 5"):
        reset(session)


def test_unusable_settings_are_refused(start: Start) -> None:
    program = start()
    spaces_of_cart: dict[str, Any] = {
        "action_space": spaces.Discrete(2),
        "observation_space": _CART,
    }
    with pytest.raises(ConfigError, match="2 games cannot share one port"):
        ludus.make_vec(program.url, num_engines=2, **spaces_of_cart)
    with pytest.raises(ConfigError, match="action_space"):
        ludus.make(program.url, observation_space=_CART)
    with pytest.raises(ConfigError, match="no setting colour"):
        ludus.make(program.url, colour="red", **spaces_of_cart)
    with pytest.raises(ConfigError, match="num_agents is 0"):
        program.open(num_agents=0)
    with pytest.raises(ConfigError, match="with_pixels needs a uint8 box"):
        program.open(with_pixels=True)
    with pytest.raises(UsageError, match="unknown reset option 'wind'"):
        program.open().reset(ResetRequest.all_worlds(1, 7, {"wind": 1}))
