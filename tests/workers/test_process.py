"""Workers as processes: the same bits, one clear error when one is lost, and nothing left over."""

from __future__ import annotations

import os
import re
import resource
import signal
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import psutil
import pytest

import ludus
from ludus.errors import (
    ConfigError,
    MachineLost,
    MissingExtra,
    RunError,
    TargetError,
    UsageError,
)
from ludus.settings.train_config import PPOConfig
from ludus.training.hooks import Training
from ludus.training.loop import train
from ludus.workers import process
from tests.workers.machines import assert_equal, newest
from tests.workers.test_equal_bits import PPO, config

pytestmark = pytest.mark.slow


def workers() -> list[psutil.Process]:
    """Return the worker processes of this process."""
    return [
        child
        for child in psutil.Process().children(recursive=True)
        if child.is_running() and "ludus.workers.process" in child.cmdline()
    ]


@pytest.fixture(autouse=True)
def nothing_left() -> Any:
    yield
    assert workers() == []


@pytest.mark.training
@pytest.mark.parametrize("case", ["ppo", "sac"])
def test_processes_give_the_checkpoint_of_a_run_without_any(case: str, tmp_path: Path) -> None:
    alone, spread = (train(config(case, tmp_path, cluster)) for cluster in (None, "local:2"))
    assert_equal(newest(alone.path), newest(spread.path))
    assert spread.evaluation == alone.evaluation


@pytest.mark.training
def test_a_run_goes_on_in_another_layout_to_the_bit(tmp_path: Path) -> None:
    ppo = PPOConfig(**PPO, learning_rate_schedule="constant")  # the linear one sees total_steps
    whole = train(config("ppo", tmp_path, None, ppo=ppo))
    half = config("ppo", tmp_path, "local:2", ppo=ppo, total_steps=192, name="half")
    part = train(half)
    resumed = train(config("ppo", tmp_path, None, ppo=ppo), resume=part.path)
    assert_equal(newest(whole.path), newest(resumed.path))


class Striking:
    """Sends a worker a signal after the first update, once."""

    def __init__(self, signum: int) -> None:
        self.at_s: float | None = None
        self._signum = signum

    def __call__(self, training: Training) -> None:
        if self.at_s is None:
            self.at_s = time.monotonic()
            os.kill(workers()[1].pid, self._signum)


@pytest.mark.training
@pytest.mark.parametrize("signum", [signal.SIGKILL, signal.SIGSTOP])
def test_a_lost_worker_is_started_again_and_the_run_goes_on(
    signum: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(process, "SILENCE_S", 8.0)
    strike = Striking(signum)
    run = ludus.train(config("ppo", tmp_path, "local:2"), on_update=strike, progress=False)
    assert run.stop_reason == "total_steps"
    assert run.metrics[-1]["restarts"] == 1
    learnt = [line["policies"]["agent"]["num_transitions"] for line in run.metrics]
    assert sorted(learnt) == [48.0] + [96.0] * (len(learnt) - 1)  # one rollout of one worker
    said = "exit code -9" if signum == signal.SIGKILL else "no sign of life"
    assert re.search(f"machine 1 .*{said}.*1 of 3", (run.path / "train.log").read_text())


def test_a_worker_that_may_not_be_started_again_ends_the_run_with_one_error(tmp_path: Path) -> None:
    settings = config("sac", tmp_path, "local:2", total_steps=50_000, max_restarts=0)
    with pytest.raises(MachineLost, match=r"machine 1 .* exit code -9") as caught:
        ludus.train(settings, on_update=Striking(signal.SIGKILL), progress=False)
    assert "--resume" in caught.value.hint
    assert newest(tmp_path / "local:2").agent_steps >= 120


def test_a_full_disk_ends_the_run_with_one_error(tmp_path: Path) -> None:
    """The real thing needs a file system of its own, as the campaign has; this is the next best."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)

    def fill(training: Training) -> None:
        assert training.progress is not None
        if training.progress.agent_steps == 3 * 96:  # there is a checkpoint of the second update
            resource.setrlimit(resource.RLIMIT_FSIZE, (16 << 10, limits[1]))

    ppo = replace(PPOConfig(**PPO), hidden_sizes=(64, 64))  # larger than all other files
    try:
        with pytest.raises(RunError, match=r"cannot write the checkpoint .*File too large"):
            ludus.train(config("ppo", tmp_path, "local:2", ppo=ppo), on_update=fill, progress=False)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert newest(tmp_path / "local:2").agent_steps == 2 * 96


def test_an_error_of_a_worker_is_told_as_without_a_cluster(tmp_path: Path) -> None:
    with pytest.raises(TargetError, match="Nothing-v0"):
        ludus.train("gym:Nothing-v0", cluster="local:2", runs=tmp_path, progress=False)


def test_what_a_cluster_cannot_do_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def make(*_: Any) -> Any:
        raise AssertionError

    settings = config("ppo", tmp_path, "local:2")
    with pytest.raises(UsageError, match="networks of a script"):
        ludus.train(settings, networks={"agent": make})
    with pytest.raises(ConfigError, match="names 1 running games, and there are 2 workers"):
        ludus.train("localhost:11008", cluster="local:2", runs=tmp_path)
    with pytest.raises(ConfigError, match="play waits for one game, and a cluster has many"):
        ludus.train("play", cluster="local:2", runs=tmp_path)
    with pytest.raises(TargetError, match="several games, and each needs a worker of its own"):
        ludus.train("localhost:11008,localhost:11009", runs=tmp_path)
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(MissingExtra, match="ray is not installed") as caught:
        ludus.train("cartpole", cluster="auto", runs=tmp_path)
    assert "pip install" in caught.value.hint
    with pytest.raises(ConfigError, match=re.escape("cluster must be local:N")):
        ludus.train("cartpole", cluster="local:0", runs=tmp_path)
    assert list(tmp_path.iterdir()) == []
