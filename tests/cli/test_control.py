"""``ludus control`` on a real run in another process."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from ludus.cli.main import main
from ludus.runs.metrics import read_metrics
from ludus.runs.run_folder import RunFolder
from ludus.runs.run_list import list_runs
from tests.cli.short_runs import short_run

ENDLESS = [
    "gym:CartPole-v1", "--num-worlds", "4", "--num-engines", "1", "--total-steps", "100000000",
    "--ppo.rollout-steps", "32", "--ppo.hidden-sizes", "8", "--seed", "1",
    "--checkpoint-every-s", "None", "--evaluation-episodes", "2", "--name", "r",
]  # fmt: skip


@pytest.fixture
def running(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """A process that trains in ``runs/r`` of the current folder, and has made an update."""
    monkeypatch.chdir(tmp_path)
    child = subprocess.Popen(
        [sys.executable, "-u", "-m", "ludus.cli", "train", *ENDLESS],
        stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
    )  # fmt: skip
    try:
        wait_until(lambda: bool(learning()))
        yield child
    finally:
        child.kill()
        child.wait()


def learning() -> list[float]:
    """Return of each update whether the policy learnt."""
    path = Path("runs/r/metrics.jsonl")
    lines = read_metrics(path) if path.exists() else []
    return [line["policies"]["agent"]["is_learning"] for line in lines]


def wait_until(is_so: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 60.0
    while not is_so():
        assert time.monotonic() < deadline
        time.sleep(0.05)


@pytest.mark.slow
def test_a_running_run_is_frozen_saved_and_stopped(
    running: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["control", "runs/r", "agent=frozen"]) == 0
    assert capsys.readouterr().out == "runs/r accepted: agent=frozen\n"
    wait_until(lambda: learning()[-1] == 0.0)
    assert learning()[0] == 1.0

    before = len(list(Path("runs/r/checkpoints").glob("step-*")))
    assert main(["control", "agent=train", "--save"]) == 0  # the only run that is running
    assert capsys.readouterr().out == "runs/r accepted: agent=train, save\n"
    wait_until(lambda: len(list(Path("runs/r/checkpoints").glob("step-*"))) > before)
    wait_until(lambda: learning()[-1] == 1.0)

    assert main(["control", "runs/r", "--stop"]) == 0
    assert running.wait(60) == 0
    assert json.loads(Path("runs/r/result.json").read_bytes())["stop_reason"] == "stopped"
    assert list_runs(Path("runs"))[0].state == "stopped"
    assert main(["control", "--stop"]) == 2
    assert "no run in runs is running" in capsys.readouterr().err


@pytest.mark.slow
def test_what_the_run_does_not_know_is_refused(
    running: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    for typed, text in (
        (["runs/r"], "nothing to change"),
        (["runs/r", "agnt=frozen"], "did you mean agent?"),
        (["runs/r", "hero=frozen"], "policies of the run: agent"),
        (["runs/r", "agent=forzen"], "did you mean frozen?"),
        (["runs/r", "agent=off"], "modes: train, frozen, deterministic"),
        (["runs/r", "frozen"], "write POLICY=MODE"),
        (["runs/r", "agent=frozen", "agent=train"], "agent is named twice"),
    ):
        assert main(["control", *typed]) == 2
        assert text in capsys.readouterr().err
    assert not any(Path("runs/r").glob("control/*"))
    assert running.poll() is None


@pytest.mark.slow
def test_requests_are_withdrawn_when_the_run_dies(
    running: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    import signal
    import threading

    running.send_signal(signal.SIGSTOP)
    assert main(["control", "runs/r", "--save", "--timeout", "0.3"]) == 5
    assert "did not react within 0.3 s" in capsys.readouterr().err

    def kill_when_asked() -> None:
        wait_until(lambda: len(list(Path("runs/r/control").iterdir())) == 2)
        running.kill()

    killer = threading.Thread(target=kill_when_asked)
    killer.start()
    assert main(["control", "runs/r", "--stop"]) == 5
    killer.join()
    captured = capsys.readouterr()
    assert "ended before it took the request" in captured.err
    assert captured.out == ""
    names = [json.loads(path.read_bytes())["kind"] for path in Path("runs/r/control").iterdir()]
    assert names == ["save"]  # the stop was withdrawn


def test_a_run_that_has_ended_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = short_run(tmp_path)
    assert main(["control", str(run), "--stop"]) == 5
    error = capsys.readouterr().err
    assert "is not running" in error
    assert f"ludus train --resume {run}" in error
    assert not RunFolder(run).control.exists()


def test_what_is_no_run_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["control", str(tmp_path), "--stop"]) == 5
    assert "is not a run" in capsys.readouterr().err


def test_which_of_several_runs_is_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    first, second = (short_run(tmp_path / "runs", name) for name in "ab")
    monkeypatch.chdir(first.parent.parent)
    with RunFolder(first).locked(), RunFolder(second).locked():
        assert main(["control", "--save"]) == 2
    assert "several runs are running: runs/a, runs/b" in capsys.readouterr().err
