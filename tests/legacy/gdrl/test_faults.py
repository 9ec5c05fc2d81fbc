"""Games that do not connect, break the wire or say nonsense: one error each, and nothing stays."""

from __future__ import annotations

import shlex
import socket
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ludus
from ludus.errors import (
    ConfigError,
    EngineCrashed,
    EngineError,
    EngineStartError,
    EngineTimeout,
    GameError,
    ProtocolError,
    TargetError,
)
from ludus.session import Session
from ludus.spec.batch import ActionBatch
from ludus.wire.reset import ResetRequest
from tests.legacy.gdrl.conftest import open_session

pytestmark = pytest.mark.usefixtures("nothing_left")
ROOT = Path(__file__).parents[3]


def command_of(name: str) -> str:
    program = f"{shlex.quote(sys.executable)} -m tests.legacy.gdrl.fake_game"
    return f"cd {shlex.quote(str(ROOT))} && {program} {name}"


def fake(name: str, **settings: Any) -> Session:
    given: dict[str, Any] = {"start_timeout_s": 60.0, "step_timeout_s": 60.0, **settings}
    return open_session("127.0.0.1:0", command=command_of(name), **given)


def play(session: Session) -> None:
    """Play until the step in which something goes wrong, and one more."""
    try:
        (policy,) = session.spec.policies
        session.reset(ResetRequest.all_worlds(1, 7))
        for _ in range(4):
            moves = np.full((2, 1), 0.5, np.float32)
            session.send({policy.name: ActionBatch(np.zeros((2, 0), np.int64), moves)})
            session.receive()
    finally:
        session.close()


@pytest.mark.parametrize("name", ["walk", "old", "bother", "connect_again"])
def test_right_games_play(name: str) -> None:
    session = fake(name)
    assert session.spec.policies[0].name == ("shared_policy" if name == "old" else "one")
    play(session)


def test_make_vec_has_the_agents_of_all_games() -> None:
    envs = ludus.make_vec("gdrl:127.0.0.1:0", num_engines=2, command=command_of("walk"))
    try:
        observations, _ = envs.reset()
        assert observations["obs"].tolist() == [[0.0, 0.0]] * 4
        _, rewards, terminated, truncated, _ = envs.step(np.zeros((4, 1)))
        assert rewards.tolist() == [0.5, 1.0] * 2
        assert not (terminated.any() or truncated.any())
    finally:
        envs.close()


@pytest.mark.parametrize(
    ("name", "error", "what", "hint"),
    [
        ("nobody", GameError, "no agents to train", "Training"),
        ("too_few", ProtocolError, "one element for each of 3 agents, got 2", "0.3"),
        ("no_spaces", ProtocolError, "observation_space: missing", "0.3"),
        ("differ", GameError, "agents 0 and 1 of policy one have different spaces", "policy_name"),
        ("sees_nothing", GameError, r"declare nothing in get_obs_space\(\)", "at least one entry"),
        ("does_nothing", GameError, r"declare nothing in get_action_space", "at least one entry"),
        ("strange_kind", ProtocolError, "move.action_type: expected one of", "0.3"),
        ("strange_size", ProtocolError, "size.*'many'", "0.3"),
        ("huge_size", ProtocolError, "size: expected whole numbers", "0.3"),
        ("nameless", ProtocolError, "expected a text, got 2", "0.3"),
        ("exit", EngineCrashed, "no such scene", ""),
    ],
)
def test_wrong_introduction_is_one_error(
    name: str, error: type[EngineError], what: str, hint: str
) -> None:
    with pytest.raises(error, match=what) as caught:
        fake(name)
    assert hint in (caught.value.hint or "")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "what"),
    [
        ("never", "no game connected within 1.5 s at 127"),
        ("half_introduction", "no game connected within 1.5 s"),
        ("only_bother", "; what did connect was"),
    ],
)
def test_game_that_never_introduces_itself_times_out(name: str, what: str) -> None:
    with pytest.raises(EngineStartError, match=what) as caught:
        fake(name, start_timeout_s=1.5)
    assert "control_mode is Training" in caught.value.hint


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "error", "what"),
    [
        ("die", EngineCrashed, "exit code 7"),
        ("hang_up", EngineCrashed, "closed the connection|has gone"),
        ("freeze", EngineTimeout, "did not answer"),
        ("half", EngineTimeout, "did not answer"),
        ("huge", ProtocolError, "4294967295 bytes is announced"),
        ("twice", ProtocolError, "nobody had asked for"),
        ("nonsense", ProtocolError, "not JSON"),
        ("list", ProtocolError, "expected an object"),
        ("deep", ProtocolError, "nested too deeply"),
        ("other_type", ProtocolError, "type: expected 'step', got 'reset'"),
        ("one_agent", ProtocolError, "obs: expected one element for each of 2 agents, got 1"),
        ("number_done", ProtocolError, r"done\[0\]: expected true or false"),
        ("no_entry", GameError, "no entry 'obs'"),
        ("short", GameError, "observation obs does not fit"),
        ("null", GameError, "observation obs does not fit"),
        ("nan", GameError, r"nan at \[1, 1\]"),
        ("null_reward", GameError, "reward of agent 1 is nan"),
    ],
)
def test_wrong_answer_is_one_error(name: str, error: type[EngineError], what: str) -> None:
    with pytest.raises(error, match=what):
        play(fake(name, step_timeout_s=2.0 if error is EngineTimeout else 60.0))


def test_action_that_is_not_finite_is_refused() -> None:
    session = fake("walk")
    session.reset(ResetRequest.all_worlds(1, 7))
    moves = np.array([[0.0], [np.nan]], np.float32)
    with pytest.raises(ludus.LudusError, match="not finite"):
        session.send({"one": ActionBatch(np.zeros((2, 0), np.int64), moves)})
    session.close()


def test_taken_port_is_an_error() -> None:
    with (
        socket.create_server(("127.0.0.1", 0)) as taken,
        pytest.raises(EngineStartError, match="cannot wait for a game"),
    ):
        ludus.make(f"gdrl:127.0.0.1:{taken.getsockname()[1]}")


def test_project_in_csharp_is_refused(tmp_path: Path) -> None:
    (tmp_path / "project.godot").write_text("config_version=5\n")
    (tmp_path / "Player.cs").touch()
    (tmp_path / "addons/godot_rl_agents").mkdir(parents=True)
    (tmp_path / "addons/godot_rl_agents/sync.gd").touch()
    with pytest.raises(TargetError, match="all in C#") as caught:
        ludus.make(f"gdrl:{tmp_path}")
    assert "godot-mono" in caught.value.hint


@pytest.mark.parametrize(
    ("given", "what"),
    [
        ({"action_repeat": 0}, "action_repeat is 0, expected at least 1"),
        ({"reset_after": 1000}, "so it takes action_repeat, too"),
        ({"wind": 1}, "has no setting wind"),
    ],
)
def test_unusable_settings_are_refused(given: dict[str, Any], what: str) -> None:
    with pytest.raises(ConfigError, match=what):
        ludus.make_vec("gdrl:127.0.0.1:1", **given)


def test_other_machines_and_shared_ports_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="is not this machine"):
        ludus.make("gdrl:192.168.0.1:11008")
    with pytest.raises(ConfigError, match="2 games cannot share one port"):
        ludus.make_vec("gdrl:127.0.0.1:11008", num_engines=2)
    with pytest.raises(ConfigError, match=r"both .* and command are given"):
        ludus.make(f"gdrl:{tmp_path}", command="true")
    with pytest.raises(TargetError, match="no project and no scene"):
        ludus.make("gdrl:nowhere")
