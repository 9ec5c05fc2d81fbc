"""What real engines, Godot 4 and 3, can do wrong: die, freeze, hang, err; and who cleans up."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time

import pytest

from ludus.errors import (
    EngineCrashed,
    EngineStartError,
    EngineTimeout,
    GameError,
    LudusError,
    SequenceError,
    TargetError,
)
from ludus.session import EngineSession
from ludus.wire.reset import ResetRequest
from tests.godot.conftest import Game, is_gone, reset, step

pytestmark = pytest.mark.engine

NULL = {"godot4": "nothing (null): does it lack a `return`?", "godot3": "null"}
SCRIPT = {"godot4": " (res://game.gd)", "godot3": ""}


def pid_of(session: EngineSession) -> int:
    assert session.pid is not None
    return session.pid


def test_the_game_is_right_without_faults(game: Game) -> None:
    session = game.open(num_worlds=2)
    reset(session)
    batch = step(session, 5)["agent"]
    assert batch.observation["steps"].tolist() == [[5.0], [5.0]]
    assert batch.observation["rays"].tolist() == [[1.0, 2.0, 3.0]] * 2
    assert session.times.tick >= 5
    pid = pid_of(session)
    session.close()
    assert is_gone(pid, 0.1)


# The process


def test_a_killed_engine(game: Game, engine: str) -> None:
    session = game.open()
    reset(session)
    step(session)
    os.kill(pid_of(session), signal.SIGKILL)
    with pytest.raises(EngineCrashed) as caught:
        step(session, 1000)
    text = str(caught.value)
    assert "the process was killed by SIGKILL" in text
    assert "--ludus-connect=unix:" in text
    assert f"Godot Engine v{engine[-1]}" in text
    with pytest.raises(SequenceError):
        step(session)


def test_an_engine_killed_in_the_middle_of_a_step(game: Game) -> None:
    session = game.open()
    reset(session, fault="hang")
    step(session, 3)
    killer = threading.Timer(0.3, os.kill, (pid_of(session), signal.SIGKILL))
    killer.start()
    with pytest.raises(EngineCrashed, match="SIGKILL"):
        step(session)
    killer.join()


def test_a_frozen_engine(game: Game) -> None:
    session = game.open(step_timeout_s=2.0)
    reset(session)
    pid = pid_of(session)
    os.kill(pid, signal.SIGSTOP)
    began = time.monotonic()
    with pytest.raises(EngineTimeout, match="silent for 2 s"):
        step(session)
    assert time.monotonic() - began < 15.0
    assert is_gone(pid, 0.1)


def test_a_step_that_never_ends(game: Game) -> None:
    session = game.open(step_timeout_s=2.0)
    reset(session, fault="hang")
    step(session, 3)
    pid = pid_of(session)
    with pytest.raises(EngineTimeout, match=r"(?s)silent for 2 s.*step_timeout_s"):
        step(session)
    assert is_gone(pid, 0.1)


OPEN_AND_WAIT = """
import sys
from pathlib import Path
from tests.godot.conftest import Game, reset, step
session = Game(Path(sys.argv[1])).open()
reset(session, fault=sys.argv[2])
step(session, 3)
print(session.pid, flush=True)
if sys.argv[2]:
    step(session)
sys.stdin.read()
"""


@pytest.mark.parametrize("fault", ["", "hang"], ids=["waiting", "in a step"])
def test_the_engine_goes_with_its_trainer(game: Game, fault: str) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", OPEN_AND_WAIT, str(game.folder), fault],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as trainer:
        assert trainer.stdout is not None
        pid = int(trainer.stdout.readline())
        assert not is_gone(pid, 0.1)
        trainer.kill()
    assert is_gone(pid)


# The game's scripts


@pytest.mark.parametrize("method", ["get_observation", "apply_action"])
def test_a_script_error_is_shown(game: Game, method: str) -> None:
    session = game.open()
    reset(session, fault=method)
    with pytest.raises(GameError) as caught:
        step(session, 20_000)  # a busy machine may keep the thread waiting that reads the output
    text = str(caught.value)
    assert "SCRIPT ERROR" in text
    assert f"{method} (res://game.gd:" in text
    assert is_gone(pid_of(session), 0.1)


@pytest.mark.parametrize(
    ("fault", "what"),
    [
        (
            "size",
            'world 1, agent Cart/LudusAgent{script}, step 3: observation["steps"]: '
            "expected 1 numbers, got {null}",
        ),
        ("nan", 'agent: world 1, agent Cart/LudusAgent: observation["rays"][1] is nan at step 3'),
        ("reward", "agent: world 1, agent Cart/LudusAgent: reward is inf at step 3"),
    ],
)
def test_a_wrong_number_has_a_place(game: Game, engine: str, fault: str, what: str) -> None:
    session = game.open(num_worlds=2)
    reset(session)
    step(session)
    per_world = [None, {"fault": fault}]
    request = reset_of(per_world)
    session.reset(request)
    step(session, 2)
    with pytest.raises(GameError) as caught:
        step(session)
    what = what.replace("{null}", NULL[engine]).replace("{script}", SCRIPT[engine])
    assert caught.value.message.splitlines()[0] == what
    assert is_gone(pid_of(session), 0.1)


def reset_of(parameters: list[dict[str, str] | None]) -> ResetRequest:
    return ResetRequest.all_worlds(len(parameters), 7, parameters)


def test_a_call_that_fails_is_not_fatal(game: Game) -> None:
    session = game.open()
    reset(session)
    target = {"world": 0, "agent": "Cart/LudusAgent"}
    assert session.call(target, "ludus_is", ["hang"]) is False
    with pytest.raises(GameError, match="no method fly"):
        session.call(target, "fly")
    with pytest.raises(GameError, match="no world or agent"):
        session.call({"world": 7}, "fly")
    step(session)


# Scenes that cannot be trained


@pytest.mark.parametrize(
    ("scene", "what"),
    [
        ("no_agent", "has no enabled LudusAgent"),
        ("no_action", "res://no_action.tscn: agent Cart/LudusAgent: no action is declared"),
        ("no_reset", "agent Cart/LudusAgent: Cart (res://no_reset.gd) has no method reset()"),
        ("disagreeing", "agent Cart/Other has ticks_per_step 4, another agent has 1"),
    ],
)
def test_a_scene_that_cannot_be_trained(game: Game, scene: str, what: str) -> None:
    with pytest.raises(TargetError) as caught:
        game.open(scene)
    assert what in caught.value.message
    assert f"res://{scene}.tscn" in caught.value.message
    assert game.engines() == []


def test_a_script_that_cannot_be_parsed(game: Game) -> None:
    with pytest.raises(LudusError) as caught:
        game.open("broken")
    assert "res://broken.gd" in str(caught.value)
    assert "Parse Error" in str(caught.value)
    assert game.engines() == []


def test_a_scene_that_is_not_on_disk(game: Game) -> None:
    with pytest.raises(TargetError, match="there is no scene"):
        game.open("nowhere")
    assert game.engines() == []


def test_a_scene_that_the_game_lacks(game: Game) -> None:
    with pytest.raises(TargetError, match=r'there is no scene "res://nowhere\.tscn"'):
        game.open(engine_scene="res://nowhere.tscn")
    assert game.engines() == []


def test_a_scene_that_hangs_when_it_is_made(game: Game) -> None:
    reset(game.open())  # the project is imported now
    game.close()
    began = time.monotonic()
    with pytest.raises(EngineStartError, match=r"(?s)did not send its spec.*start_timeout_s"):
        game.open("hangs", start_timeout_s=6.0)
    assert time.monotonic() - began < 18.0
    assert game.engines() == []


def test_a_game_that_dies_when_it_is_made(game: Game) -> None:
    with pytest.raises(EngineCrashed, match=r"(?s)the process was killed.*--ludus-connect"):
        game.open("quits")
    assert game.engines() == []


@pytest.mark.parametrize("num_worlds", [0, 65_537])
def test_a_number_of_worlds_that_is_refused(game: Game, num_worlds: int) -> None:
    with pytest.raises(TargetError, match=f"num_worlds is {num_worlds}, the limit is 65536"):
        game.open(num_worlds=num_worlds)
    assert game.engines() == []
