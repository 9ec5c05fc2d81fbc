"""What a game can do wrong: die, freeze, talk nonsense, never come."""

from __future__ import annotations

import os
import signal
import socket
import time
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

from ludus.errors import (
    EngineCrashed,
    EngineError,
    EngineStartError,
    EngineTimeout,
    GameError,
    ProtocolError,
    SequenceError,
    SetupError,
)
from ludus.extras import install_hint
from ludus.legacy.gymgodot import making
from tests.legacy.gymgodot.conftest import Opener, game_of, left_processes, running_game

pytestmark = pytest.mark.slow
STEP = np.array([0.25], np.float32)


def step_until_wrong(env: gymnasium.Env[Any, Any]) -> None:
    """Two steps go well, the third does not; the game is gone then."""
    env.reset()
    for count in (1.0, 2.0):
        assert env.step(STEP)[0][1] == count
    try:
        env.step(STEP)
    finally:
        assert left_processes() == []
        with pytest.raises(SequenceError, match="the game is closed"):
            game_of(env).reset()


@pytest.mark.parametrize(
    ("name", "kind", "what"),
    [
        ("hang_up", EngineCrashed, "the game closed the connection: the process ended with exit"),
        ("nonsense", ProtocolError, "not JSON .*this is not JSON"),
        ("list", ProtocolError, r"answer: expected an object, got \[1, 2\]"),
        ("binary", ProtocolError, "a binary message came"),
        ("huge", ProtocolError, "too long"),
        ("no_reward", ProtocolError, "answer.reward: missing"),
        ("number_done", ProtocolError, "answer.done: expected true or false, got 1"),
        ("inf", GameError, "the reward is -inf"),
    ],
)
def test_wrong_answer_raises_a_documented_error(
    opener: Opener, name: str, kind: type[EngineError], what: str
) -> None:
    env = opener.fake(name)
    with pytest.raises(kind, match=what) as caught:
        step_until_wrong(env)
    assert type(caught.value) is kind


@pytest.mark.parametrize(
    ("name", "what"),
    [
        ("nan", r"observation does not fit observation_space: nan at \[1\]"),
        ("short", r"shape \[1\] instead of \[2\]"),
        ("ragged", "lists of different lengths"),
        ("null", "something that is not a number: None"),
    ],
)
def test_wrong_observation_names_what_is_wrong(opener: Opener, name: str, what: str) -> None:
    env = opener.fake(name)
    with pytest.raises(GameError, match=what):
        step_until_wrong(env)


def test_crash_report_holds_exit_code_output_and_command(opener: Opener) -> None:
    env = opener.fake("die")
    with pytest.raises(EngineCrashed, match="exit code 7") as caught:
        step_until_wrong(env)
    assert "| about to fall" in str(caught.value)
    assert "fake_game die --fixed-fps 60 --disable-render-loop" in str(caught.value)


def test_killed_game_is_a_crash(opener: Opener) -> None:
    env = opener.fake("walk")
    env.reset()
    os.kill(running_game().pid, signal.SIGKILL)
    with pytest.raises(EngineCrashed, match=r"closed the connection|Broken pipe|reset"):
        for _ in range(5):
            env.step(STEP)


@pytest.mark.parametrize("name", ["freeze", "ping", "split"])
def test_silent_game_times_out(opener: Opener, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    # No message reaches this length before the deadline.
    monkeypatch.setattr(making, "max_message_bytes", _any_length)
    env = opener.fake(name, step_timeout_s=2.0)
    env.reset()
    for _ in range(2):
        env.step(STEP)
    began = time.monotonic()
    with pytest.raises(EngineTimeout, match=r"did not answer.*within 2 s"):
        env.step(STEP)
    assert time.monotonic() - began < 20.0
    assert left_processes() == []


def _any_length(_space: Any) -> int:
    return 1 << 26


def test_unsolicited_answer_is_refused(opener: Opener) -> None:
    env = opener.fake("twice")
    env.reset()
    for _ in range(3):
        env.step(STEP)
    time.sleep(0.3)
    with pytest.raises(ProtocolError, match=r"nobody had asked|init_observation: missing"):
        env.reset()


def test_command_that_ends_is_a_crash(opener: Opener) -> None:
    with pytest.raises(EngineCrashed, match="exit code 1") as caught:
        opener.fake("exit")
    assert "! ERROR: no such scene" in str(caught.value)


def test_missing_command_is_a_crash(opener: Opener) -> None:
    with pytest.raises(EngineCrashed, match="exit code 127"):
        opener.open("there-is-no-such-program")


@pytest.mark.parametrize(
    ("name", "what"),
    [("never", "no game connected within 1 s at"), ("only_bother", "what did connect was no game")],
)
def test_start_timeout_says_who_connected(opener: Opener, name: str, what: str) -> None:
    began = time.monotonic()
    with pytest.raises(EngineStartError, match=what) as caught:
        opener.fake(name, start_timeout_s=1.0 if name == "never" else 8.0)
    assert "start_timeout_s" in caught.value.hint
    assert time.monotonic() - began < 25.0
    assert left_processes() == []


def test_other_clients_are_disconnected(opener: Opener, tmp_path: Path) -> None:
    env = opener.fake("bother", log_path=tmp_path / "log")
    env.reset()
    assert env.step(STEP)[0].tolist() == [0.25, 1.0]
    env.close()
    lines = (tmp_path / "log").read_text().splitlines()
    assert len(lines) == 5
    assert not any("101" in line for line in lines)
    assert "HTTP/1.1 403" in lines[2] or "HTTP/1.1 40" in lines[2]


def test_a_crowd_of_silent_visitors_keeps_no_game_out(opener: Opener) -> None:
    began = time.monotonic()
    env = opener.fake("crowd")
    env.reset()
    assert env.step(STEP)[0].tolist() == [0.25, 1.0]
    assert time.monotonic() - began < 20.0  # one at a time, they would take minutes


def test_taken_port_is_a_start_error(opener: Opener) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        with pytest.raises(EngineStartError, match=f"127.0.0.1:{port}: Address already") as caught:
            opener.fake("walk", serverPort=port)
    assert "serverPort" in caught.value.hint
    assert left_processes() == []


def test_missing_folder_for_frames_is_named(opener: Opener, tmp_path: Path) -> None:
    env = opener.fake("walk", renderPath=f"{tmp_path}/missing/")
    env.reset()
    with pytest.raises(GameError, match=r"missing/0\.png: error 12 \(ERR_FILE_CANT_OPEN\)"):
        env.render()
    assert env.step(STEP)[0].tolist() == [0.25, 1.0]


@pytest.mark.parametrize("content", [None, b"", b"\x89PNG\r\n\x1a\nxxxx", b"GIF89a"])
def test_unreadable_frame_is_named(opener: Opener, tmp_path: Path, content: bytes | None) -> None:
    if content is not None:
        (tmp_path / "0.png").write_bytes(content)
    env = opener.fake("render_nowhere", render_mode="rgb_array", renderPath=f"{tmp_path}/")
    env.reset()
    with pytest.raises(GameError, match=r"0\.png, which cannot be read"):
        env.render()


def test_missing_package_names_the_extra(opener: Opener, monkeypatch: pytest.MonkeyPatch) -> None:
    def find_nothing(_name: str) -> None:
        return None

    monkeypatch.setattr(making, "find_spec", find_nothing)
    with pytest.raises(SetupError, match="websockets and pillow") as caught:
        opener.fake("walk")
    assert caught.value.hint == install_hint("gymgodot")


def test_an_interrupt_ends_the_game(opener: Opener) -> None:
    env = opener.fake("freeze")
    env.reset()
    for _ in range(2):
        env.step(STEP)
    before = signal.signal(signal.SIGALRM, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            signal.setitimer(signal.ITIMER_REAL, 1.0)
            env.step(STEP)
    finally:
        signal.signal(signal.SIGALRM, before)
    assert left_processes() == []
