"""Worker processes with real Godot games: equal bits, several policies, a game that is killed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import psutil
import pytest

import ludus
from ludus.runs.metrics import read_metrics
from ludus.settings.train_config import LeagueConfig, PPOConfig, TrainConfig
from ludus.training.hooks import Training
from ludus.training.loop import train
from tests.godot.test_strangers import listening
from tests.training.test_on_engine import SAC_IN_SCENE, Stopping, pennies
from tests.workers.machines import assert_equal, newest, use_in_process
from tests.workers.test_process import nothing_left, workers

__all__ = ["nothing_left", "pennies"]

pytestmark = [pytest.mark.engine, pytest.mark.slow, pytest.mark.training]


def test_two_policies_that_take_turns_learn_the_same(
    pennies: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One of them by PPO, the other by SAC, each frozen while the other learns."""
    use_in_process(monkeypatch)
    alone = pennies(SAC_IN_SCENE, num_engines=2, alternate_every=3, evaluation_episodes=4)
    spread = replace(alone, num_engines=1, cluster="local:2", name="spread")
    first, second = train(alone), train(spread)
    assert_equal(newest(first.path), newest(second.path))
    assert first.evaluation == second.evaluation
    modes = [[line["policies"][name]["is_learning"] for name in ("even", "odd")]
             for line in read_metrics(second.path / "metrics.jsonl")]  # fmt: skip
    assert [1.0, 0.0] in modes
    assert [0.0, 1.0] in modes


def test_self_play_against_past_selves_is_the_same_on_workers(
    pennies: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Who meets whom, ratings, past selves and what is learnt from them; one learner is SAC's."""
    use_in_process(monkeypatch)
    league = LeagueConfig(share=0.5, snapshot_every_updates=2, pool_size=2, sampling="rating")
    alone = pennies(SAC_IN_SCENE, num_engines=4, league=league, alternate_every=3,
                    total_steps=6400, evaluation_episodes=4)  # fmt: skip
    first = newest(train(alone).path)
    for cluster, engines in (("local:2", 2), ("local:4", 1)):
        spread = train(replace(alone, num_engines=engines, cluster=cluster, name=cluster))
        assert_equal(first, newest(spread.path))
    assert first.run["updates"] >= 8
    assert len(set(first.run["league"]["ratings"].values())) == 2


def test_a_resumed_league_goes_on_in_another_layout_to_the_bit(pennies: Any) -> None:
    league = LeagueConfig(share=0.5, snapshot_every_updates=2)
    whole = pennies(num_engines=2, league=league, exact_resume=True, total_steps=10**9,
                    checkpoint_every_updates=2, name="whole")  # fmt: skip
    train(whole, reporter=Stopping(8))
    spread = replace(whole, num_engines=1, cluster="local:2", name="half")
    half = train(spread, reporter=Stopping(4))
    train(replace(whole, name="half"), resume=half.path, reporter=Stopping(4))
    assert_equal(newest(whole.runs / "whole"), newest(half.path))


def test_each_worker_plays_a_game_that_runs_already(tmp_path: Path) -> None:
    with listening("cartpole") as (_, first), listening("cartpole") as (_, second):
        run = ludus.train(
            f"127.0.0.1:{first},127.0.0.1:{second}", cluster="local:2", num_engines=1,
            num_worlds=4, total_steps=1024, seed=5, runs=tmp_path, evaluation_episodes=4,
            progress=False,
        )  # fmt: skip
    alone = ludus.train(
        "cartpole", num_engines=2, num_worlds=4, total_steps=1024, seed=5, runs=tmp_path,
        evaluation_episodes=4, progress=False,
    )  # fmt: skip
    assert run.evaluation == alone.evaluation


def test_a_killed_game_is_replaced_by_its_worker(tmp_path: Path) -> None:
    config = TrainConfig(
        "cartpole", num_worlds=4, num_engines=1, seed=5, total_steps=8 * 16 * 12,
        ppo=PPOConfig(hidden_sizes=(16,), rollout_steps=16), runs=tmp_path, name="run",
        evaluation_episodes=0, cluster="local:2",
    )  # fmt: skip
    killed: list[int] = []

    def kill(training: Training) -> None:
        if not killed:
            games = [
                game for worker in workers() for game in psutil.Process(worker.pid).children(True)
            ]
            killed.append(games[0].pid)
            os.kill(games[0].pid, signal.SIGKILL)

    run = ludus.train(config, on_update=kill, progress=False)
    assert run.stop_reason == "total_steps"
    assert run.metrics[-1]["restarts"] == 1
    assert not any(psutil.pid_exists(pid) for pid in killed)


@pytest.mark.parametrize("is_stopped", [False, True])
def test_workers_and_games_end_with_a_trainer_that_is_killed(
    tmp_path: Path, is_stopped: bool
) -> None:
    command = [
        sys.executable, "-m", "ludus", "train", "cartpole", "--cluster", "local:2",
        "--num-engines", "1", "--num-worlds", "4", "--total-steps", "100000000",
        "--runs", str(tmp_path), "--name", "run",
    ]  # fmt: skip
    trainer = psutil.Popen(command, stdin=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    metrics = tmp_path / "run" / "metrics.jsonl"
    wait_until(lambda: metrics.exists() and len(read_metrics(metrics)) > 2)
    started = trainer.children(recursive=True)
    assert len(started) >= 4  # two workers and their games
    if is_stopped:
        next(each for each in started if "ludus.workers.process" in each.cmdline()).suspend()
    trainer.kill()
    trainer.wait()
    _, left = psutil.wait_procs(started, timeout=60.0)
    assert left == []


def wait_until(is_so: Callable[[], bool]) -> None:
    limit_s = time.monotonic() + 120.0
    while not is_so():
        assert time.monotonic() < limit_s
        time.sleep(0.2)
