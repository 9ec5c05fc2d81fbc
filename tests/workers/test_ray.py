"""Workers on the nodes of a Ray cluster on this machine; one cluster for all tests."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import psutil
import pytest

import ludus
from ludus.cli.main import main
from ludus.engine.cache import require_cache_root
from ludus.errors import ConfigError, RunError
from ludus.runs.metrics import read_metrics
from ludus.settings.merging import Layer
from ludus.settings.train_config import PPOConfig, TrainConfig
from ludus.training.hooks import Training
from ludus.training.loop import train
from ludus.tuning.sweeping import SweepConfig, run_sweep
from ludus.version import __version__
from ludus.workers.parcel import find_parcel, has_parcel
from tests.training.test_on_engine import pennies
from tests.workers.machines import assert_equal, newest
from tests.workers.test_equal_bits import PPO, config
from tests.workers.test_on_engine import wait_until

__all__ = ["pennies"]

pytestmark = [
    pytest.mark.cluster,
    # The nodes start with the first test, and see the engines that it sees.
    pytest.mark.engine,
    # What Ray does on its own account.
    pytest.mark.filterwarnings("default"),
]


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    pytest.importorskip("ray")
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    import ray as ray_package
    from ray.cluster_utils import Cluster

    ray: Any = ray_package
    made: Any = Cluster()
    add_node(made, num_cpus=0, include_dashboard=False)
    made.connect()
    for _ in range(2):
        add_node(made)
    made.wait_for_nodes(timeout=150.0)
    yield made
    ray.shutdown()
    made.shutdown()


def add_node(cluster: Any, **settings: Any) -> Any:
    """Add a node; one that a busy machine has not started after 30 s gets another chance."""
    for attempt in range(3):
        try:
            return cluster.add_node(**{"num_cpus": 1, **settings})
        except Exception as error:
            if attempt == 2 or "timed out" not in str(error):
                raise
    raise AssertionError


def on_ray(case: str, tmp_path: Path, **changes: Any) -> TrainConfig:
    local = config(case, tmp_path, "local:2")
    spread = replace(local, cluster="auto", num_machines=2, name="ray")
    return replace(spread, **changes)


def test_layouts_give_the_checkpoint_of_one_process(cluster: Any, tmp_path: Path) -> None:
    joined = [add_node(cluster) for _ in range(2)]
    try:
        # A worker takes seconds to start; test_equal_bits has each case with each layout.
        for case, nums in (("ppo", (1, 4)), ("sac", (2,))):
            alone = train(config(case, tmp_path / case, None))
            for num in nums:
                layout = {"num_machines": num, "num_engines": 4 // num, "name": f"{num} machines"}
                spread = train(on_ray(case, tmp_path / case, **layout))
                assert_equal(newest(alone.path), newest(spread.path))
                assert spread.evaluation == alone.evaluation
    finally:
        for node in joined:
            cluster.remove_node(node)


def test_more_machines_than_there_are_is_refused(cluster: Any, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"num_machines is 9, and the cluster has \d machines"):
        train(on_ray("ppo", tmp_path, num_machines=9))


def test_real_games(cluster: Any, tmp_path: Path) -> None:
    run = ludus.train(
        "cartpole", cluster="auto", num_engines=1, num_worlds=4, total_steps=2048,
        evaluation_episodes=4, runs=tmp_path, name="run", progress=False,
    )  # fmt: skip
    assert run.stop_reason == "total_steps"
    assert run.evaluation["cart"].num_episodes == 4


def actors() -> list[psutil.Process]:
    """Return the processes of workers on the nodes, oldest first."""
    found = [
        process for process in psutil.process_iter(["cmdline", "create_time"])
        if "ray::_Actor" in " ".join(process.info["cmdline"] or [])
    ]  # fmt: skip
    return sorted(found, key=lambda process: process.info["create_time"])


def require_no_actors() -> None:
    """Require that no worker is left; Ray ends them soon after it is told to."""
    assert psutil.wait_procs(actors(), timeout=30.0)[1] == []


@pytest.mark.parametrize("signum", [signal.SIGKILL, signal.SIGSTOP])
def test_a_lost_worker_is_started_again(
    signum: int, cluster: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ludus.workers.ray_machines.SILENCE_S", 5.0)
    monkeypatch.setattr("ludus.workers.ray_machines.LOOK_S", 1.0)
    struck: list[psutil.Process] = []

    def strike(_: Training) -> None:
        if not struck:
            struck.append(actors()[-1])
            struck[0].send_signal(signum)

    run = ludus.train(on_ray("ppo", tmp_path), on_update=strike, progress=False)
    assert run.stop_reason == "total_steps"
    assert run.metrics[-1]["restarts"] == 1
    learnt = [line["policies"]["agent"]["num_transitions"] for line in run.metrics]
    assert sorted(learnt) == [48.0] + [96.0] * (len(learnt) - 1)  # one rollout of one worker
    said = "is lost" if signum == signal.SIGKILL else "no sign of life for 5 s"
    assert said in (run.path / "train.log").read_text()
    psutil.wait_procs(struck, timeout=10.0)
    assert not struck[0].is_running()


def test_a_project_is_sent_once(cluster: Any, tmp_path: Path, pennies: Any) -> None:
    config = pennies(cluster="auto", num_machines=2, total_steps=640)
    parcel = find_parcel(config.target, None, None)
    assert parcel is not None
    played: set[str] = set()

    def look(_: Training) -> None:
        games = psutil.process_iter(["cmdline"])
        played.update(" ".join(game.info["cmdline"] or []) for game in games)

    run = ludus.train(config, on_update=look, progress=False)
    assert run.stop_reason == "total_steps"
    kept = require_cache_root() / "games" / parcel.digest
    assert any(str(kept) in command for command in played)
    assert not any(config.target in command for command in played)
    assert has_parcel(parcel.digest)
    shutil.rmtree(kept)


def test_a_sweep_runs_every_trial_on_the_cluster(cluster: Any, tmp_path: Path) -> None:
    settings = {
        "target": "gym:tests.workers.environments:Identity-discrete-v0", "cluster": "auto",
        "num_machines": 1, "num_engines": 2, "num_worlds": 3, "total_steps": 96, "seed": 5,
        "runs": str(tmp_path), "name": "sweep", "ppo": PPO,
    }  # fmt: skip
    space = {"ppo.learning_rate": "log:1e-4:1e-2"}
    sweep = run_sweep(SweepConfig(space, (Layer("test", settings),)), 2)
    assert [trial.state for trial in sweep.trials] == ["complete"] * 2
    assert len({trial.score for trial in sweep.trials}) > 1
    require_no_actors()


def large(tmp_path: Path) -> TrainConfig:
    """One rollout of 229 MB; a node keeps 157 MB in memory."""
    ppo = PPOConfig(hidden_sizes=(8,), rollout_steps=64, epochs=1, minibatch_size=1024)
    return TrainConfig(
        "gym:tests.workers.environments:Wide-v0", cluster="auto", num_machines=1, num_engines=1,
        num_worlds=32, total_steps=32 * 64, seed=1, ppo=ppo, runs=tmp_path, name="run",
        evaluation_episodes=0,
    )  # fmt: skip


def test_a_rollout_that_is_larger_than_the_object_store(cluster: Any, tmp_path: Path) -> None:
    assert train(large(tmp_path)).stop_reason == "total_steps"


def test_an_object_store_and_a_disk_that_are_full_end_the_run_with_one_error(
    cluster: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RAY_local_fs_capacity_threshold", "0.001")  # for Ray, that is a full disk
    full = add_node(cluster, num_cpus=2)  # the most, so that the run gets this node
    try:
        with pytest.raises(RunError, match=r"data from machine 0 \(.*\) does not fit") as caught:
            train(large(tmp_path))
    finally:
        cluster.remove_node(full)
    assert "--object-store-memory" in caught.value.hint
    assert newest(tmp_path / "run").agent_steps == 0
    require_no_actors()


def test_the_cluster_is_checked(cluster: Any, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["cluster", "check", "cartpole", "--seconds", "1", "--json"]) == 0
    reports = json.loads(capsys.readouterr().out)
    assert len(reports) >= 2
    for report in reports:
        assert report["error"] == ""
        assert report["facts"]["ludus"] == __version__
        assert report["facts"]["engines"]
        assert report["agent_steps_per_s"] > 100
        assert report["megabytes_per_s"] > 1


def test_another_version_on_a_node_is_one_error(
    cluster: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    other = tmp_path / "other"
    shutil.copytree(Path(ludus.__file__).parent, other / "ludus")
    (other / "ludus" / "version.py").write_text('__version__ = "0.0.1"\n')
    monkeypatch.setenv("PYTHONPATH", str(other))  # of what the node starts
    node = add_node(cluster)
    try:
        said = rf"node .*has Ludus 0\.0\.1, and this machine {re.escape(__version__)}"
        with pytest.raises(ConfigError, match=said) as caught:
            train(on_ray("ppo", tmp_path, num_machines=3))
        assert "same versions" in caught.value.hint
        assert main(["cluster", "check", "cartpole", "--seconds", "0.5"]) == 1
        assert "0.0.1" in capsys.readouterr().out
    finally:
        cluster.remove_node(node)
    assert not (tmp_path / "ray").exists()


def test_a_node_that_joins_takes_the_place_of_one_that_is_gone(
    cluster: Any, tmp_path: Path
) -> None:
    from ludus.workers.nodes import RayCluster

    lost: list[str] = []
    removed: list[Any] = []

    def watch(training: Training) -> None:
        progress = training.progress
        assert progress is not None
        gone = [machine.name for machine in progress.machines if machine.is_lost]
        if not removed:
            removed.append(nodes.pop())
            cluster.remove_node(removed[0], allow_graceful=False)
        elif gone and not lost:
            lost.extend(gone)
            nodes.append(add_node(cluster))
        elif lost and not gone:
            training.stop()

    nodes = [sorted(cluster.worker_nodes, key=id)[0]]
    num = len(RayCluster("auto").nodes())  # one that started late may be among them
    settings = on_ray("ppo", tmp_path, total_steps=10**9, evaluation_episodes=0, num_machines=num)
    run = ludus.train(settings, on_update=watch, progress=False)
    assert run.stop_reason == "stopped"
    assert run.metrics[-1]["restarts"] == 1
    assert "there is no node for machine" in (run.path / "train.log").read_text()


@pytest.mark.slow
def test_a_round_of_the_campaign_finds_nothing(tmp_path: Path) -> None:
    """With a cluster of its own, in a folder with files that nobody may run."""
    play_round = [sys.executable, "-m", "tests.campaign", "--faults", "nodes", "--engines", "gym"]
    done = subprocess.run(
        [*play_round, "--round", "0"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout
    assert "1 rounds" in done.stdout


def start_on(address: str, runs: Path, *flags: str) -> psutil.Popen:
    """Train in a process of its own until the first updates are made."""
    command = [
        sys.executable, "-m", "ludus", "train", "cartpole", "--cluster", address,
        "--num-machines", "2", "--num-engines", "1", "--num-worlds", "4",
        "--total-steps", "100000000", "--runs", str(runs), "--name", "run", *flags,
    ]  # fmt: skip
    with (runs / "output.txt").open("w") as output:
        trainer = psutil.Popen(command, stdin=subprocess.DEVNULL, stdout=output, stderr=output)
    metrics = runs / "run" / "metrics.jsonl"
    wait_until(lambda: metrics.exists() and len(read_metrics(metrics)) > 2)
    return trainer


def test_nothing_is_left_of_a_trainer_that_is_killed(cluster: Any, tmp_path: Path) -> None:
    trainer = start_on(cluster.address, tmp_path)
    left = [each for actor in actors() for each in (actor, *actor.children(recursive=True))]
    assert len(left) >= 4  # two workers and their games
    trainer.kill()
    trainer.wait()
    assert psutil.wait_procs(left, timeout=60.0)[1] == []


def test_a_head_that_is_gone_ends_the_run_with_one_error(cluster: Any, tmp_path: Path) -> None:
    """The last test: nothing is left of the cluster."""
    import ray as ray_package

    ray: Any = ray_package
    address = cluster.address
    trainer = start_on(address, tmp_path)
    left = [each for actor in actors() for each in (actor, *actor.children(recursive=True))]
    ray.shutdown()  # this process need not die with the head
    cluster.remove_node(cluster.head_node, allow_graceful=False)
    assert trainer.wait(timeout=90.0) == RunError.exit_code
    said = (tmp_path / "output.txt").read_text()
    assert said.count("error:") == 1
    assert f"the head of the Ray cluster, {address}, is gone" in said
    assert "Traceback" not in said
    assert newest(tmp_path / "run").agent_steps > 0
    assert psutil.wait_procs(left, timeout=60.0)[1] == []
