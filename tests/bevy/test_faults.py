"""What a Bevy game can do wrong: die, freeze, be asked for what it has not; and who cleans up."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from ludus.errors import (
    EngineCrashed,
    EngineStartError,
    EngineTimeout,
    GameError,
    SequenceError,
    TargetError,
)
from ludus.session import EngineSession, LaunchOptions, open_session
from ludus.wire.handshake import EngineConfig
from tests.bevy.conftest import Open
from tests.godot.conftest import is_gone, reset, step
from tests.targets import find_game

pytestmark = [pytest.mark.engine, pytest.mark.bevy, pytest.mark.timeout(180, func_only=True)]

DEADLINE_S = 20.0


def pid_of(session: EngineSession) -> int:
    assert session.pid is not None
    return session.pid


def test_a_killed_game(open_game: Open) -> None:
    session = open_game()
    reset(session)
    step(session)
    os.kill(pid_of(session), signal.SIGKILL)
    with pytest.raises(EngineCrashed) as caught:
        step(session, 1000)
    text = str(caught.value)
    assert "the process was killed by SIGKILL" in text
    assert "--ludus-connect=unix:" in text
    assert "--headless" not in text
    with pytest.raises(SequenceError):
        step(session)


def test_a_frozen_game(open_game: Open) -> None:
    session = open_game(step_timeout_s=2.0)
    reset(session)
    pid = pid_of(session)
    os.kill(pid, signal.SIGSTOP)
    began = time.monotonic()
    with pytest.raises(EngineTimeout, match=r"silent for 2 s: .* still running \(stopped, [01]\."):
        step(session)
    assert time.monotonic() - began < 15.0
    assert is_gone(pid, 0.5)


def test_a_closed_session_ends_the_game(open_game: Open) -> None:
    session = open_game()
    reset(session)
    pid = pid_of(session)
    session.close()
    assert is_gone(pid, 0.5)


OPEN_AND_WAIT = """
import sys
from ludus.session import open_session
from ludus.target import parse_target
from ludus.wire.handshake import EngineConfig
session = open_session(parse_target(sys.argv[1]), EngineConfig())
print(session.pid, flush=True)
sys.stdin.read()
"""


def test_the_game_goes_with_its_trainer(executable: Path) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", OPEN_AND_WAIT, str(executable)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as trainer:
        assert trainer.stdout is not None
        pid = int(trainer.stdout.readline())
        assert not is_gone(pid, 0.1)
        trainer.kill()
    assert is_gone(pid)


def test_what_the_game_cannot_do_is_said(open_game: Open, executable: Path) -> None:
    with pytest.raises(TargetError, match="a Bevy game is one program"):
        open_game(scene="res://level.tscn")
    with pytest.raises(TargetError, match="decides itself what it runs"):
        find_game(executable, scene="res://level.tscn")
    session = open_game()
    reset(session)
    with pytest.raises(GameError, match="the game has no method fly"):
        session.call({"world": 0}, "fly")
    step(session)


def test_a_game_whose_trainer_is_not_there_says_so(executable: Path) -> None:
    command = [str(executable), "--ludus-connect=unix:/nowhere/trainer,tcp:127.0.0.1:1"]
    result = subprocess.run(
        command, capture_output=True, text=True, timeout=DEADLINE_S, check=False
    )
    assert result.returncode == 1
    assert "no trainer answers at unix:/nowhere/trainer, tcp:127.0.0.1:1" in result.stderr


def test_bad_arguments_are_told(executable: Path) -> None:
    for argument, expected in [
        ("--ludus-connect=elsewhere", "expected tcp:HOST:PORT or unix:PATH"),
        ("--ludus-token-file=/no/such/file", "/no/such/file cannot be read"),
    ]:
        result = subprocess.run(
            [str(executable), argument],
            capture_output=True,
            text=True,
            timeout=DEADLINE_S,
            check=False,
        )
        assert (result.returncode, expected in result.stderr) == (1, True), result.stderr


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def test_a_listening_game_is_trained_by_address(executable: Path) -> None:
    port = free_port()
    with subprocess.Popen([str(executable), f"--ludus-listen=tcp:127.0.0.1:{port}"]) as game:
        target = find_game(f"127.0.0.1:{port}")
        session = retry_open(lambda: open_session(target, EngineConfig(num_worlds=2)))
        reset(session)
        assert step(session, 3)["cart"].active.all()
        session.close()
        assert game.wait(DEADLINE_S) == 0


def test_another_machine_needs_a_token(executable: Path, tmp_path: Path) -> None:
    port = free_port()
    listen = f"--ludus-listen=tcp:0.0.0.0:{port}"
    target = find_game(f"127.0.0.1:{port}")
    with subprocess.Popen([str(executable), listen], stderr=subprocess.PIPE, text=True) as game:
        assert game.wait(DEADLINE_S) == 1
        assert game.stderr is not None
        assert "needs a token of 16 characters" in game.stderr.read()
    file = tmp_path / "token"
    file.write_text("a secret of the two\n")
    command = [str(executable), listen, f"--ludus-token-file={file}"]
    with subprocess.Popen(command, stderr=subprocess.DEVNULL) as game:
        options = LaunchOptions(token="a secret of the two")
        session = retry_open(lambda: open_session(target, EngineConfig(), options))
        reset(session)
        session.close()
        assert game.wait(DEADLINE_S) == 0


def retry_open(open_one: Callable[[], EngineSession]) -> EngineSession:
    """Connect as soon as the game listens."""
    deadline = time.monotonic() + DEADLINE_S
    while True:
        try:
            return open_one()
        except EngineStartError as error:
            if "no game answers" not in error.message or time.monotonic() > deadline:
                raise
            time.sleep(0.05)
