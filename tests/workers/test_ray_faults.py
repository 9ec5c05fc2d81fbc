"""What goes wrong on a Ray cluster on this machine; `make campaign-cluster` runs it.

Workers, nodes and head are struck while a run goes on, stores are full, versions differ.
"""

from __future__ import annotations

import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import psutil
import pytest

import ludus
from ludus.cli.main import main
from ludus.errors import ConfigError, RunError
from ludus.runs.metrics import read_metrics
from ludus.training.hooks import Training
from ludus.training.loop import train
from ludus.version import __version__
from tests.workers.machines import newest
from tests.workers.ray_cluster import (
    actors,
    add_node,
    large_rollout,
    on_ray,
    require_no_actors,
)
from tests.workers.test_on_engine import wait_until

pytestmark = [
    pytest.mark.cluster,
    # The nodes start with the first test, and see the engines that it sees.
    pytest.mark.engine,
    # What Ray does on its own account.
    pytest.mark.filterwarnings("default"),
]


def test_lost_workers_are_started_again(
    cluster: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One that is killed, then one that is stopped."""
    monkeypatch.setattr("ludus.workers.ray_machines.SILENCE_S", 5.0)
    monkeypatch.setattr("ludus.workers.ray_machines.LOOK_S", 1.0)
    struck: list[psutil.Process] = []

    def strike(training: Training) -> None:
        assert training.progress is not None
        if len(struck) == training.progress.restarts < 2:
            struck.append(actors(cluster)[-1])
            struck[-1].send_signal([signal.SIGKILL, signal.SIGSTOP][len(struck) - 1])

    run = ludus.train(on_ray("ppo", tmp_path), on_update=strike, progress=False)
    assert run.stop_reason == "total_steps"
    assert run.metrics[-1]["restarts"] == 2
    learnt = [line["policies"]["agent"]["num_transitions"] for line in run.metrics]
    assert sorted(learnt) == [48.0] * 2 + [96.0] * (len(learnt) - 2)  # one rollout of a worker each
    said = (run.path / "train.log").read_text()
    assert "is lost" in said
    assert "no sign of life for 5 s" in said
    psutil.wait_procs(struck, timeout=10.0)
    assert not any(process.is_running() for process in struck)


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


def test_an_object_store_and_a_disk_that_are_full_end_the_run_with_one_error(
    cluster: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RAY_local_fs_capacity_threshold", "0.001")  # for Ray, that is a full disk
    full = add_node(cluster, num_cpus=2)  # the most, so that the run gets this node
    try:
        with pytest.raises(RunError, match=r"data from machine 0 \(.*\) does not fit") as caught:
            train(large_rollout(tmp_path))
    finally:
        cluster.remove_node(full)
    assert "--object-store-memory" in caught.value.hint
    assert newest(tmp_path / "run").agent_steps == 0
    require_no_actors(cluster)


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
    left = [each for actor in actors(cluster) for each in (actor, *actor.children(recursive=True))]
    assert len(left) >= 4  # two workers and their games
    trainer.kill()
    trainer.wait()
    assert psutil.wait_procs(left, timeout=60.0)[1] == []


ASK_FOR_LONG = """\
import sys, time
from ludus.errors import RunError
from ludus.workers.nodes import RayCluster

cluster = RayCluster(sys.argv[1])
print("asking", flush=True)
try:
    cluster.ask(lambda: time.sleep(300.0), cluster.nodes(), timeout_s=200.0)
except RunError as error:
    print(error.message)
"""


def test_a_head_that_is_gone_ends_the_run_with_one_error(cluster: Any, tmp_path: Path) -> None:
    """The last test: nothing is left of the cluster."""
    import ray as ray_package

    ray: Any = ray_package
    address = cluster.address
    trainer = start_on(address, tmp_path)
    asking = subprocess.Popen(
        [sys.executable, "-c", ASK_FOR_LONG, address], stdout=subprocess.PIPE, text=True
    )
    assert asking.stdout is not None
    assert asking.stdout.readline() == "asking\n"
    left = [each for actor in actors(cluster) for each in (actor, *actor.children(recursive=True))]
    ray.shutdown()  # this process need not die with the head
    cluster.remove_node(cluster.head_node, allow_graceful=False)
    told, _ = asking.communicate(timeout=90.0)
    # Ray may print what its own processes said, too.
    assert f"the head of the Ray cluster, {address}, is gone" in told.splitlines()
    assert trainer.wait(timeout=90.0) == RunError.exit_code
    said = (tmp_path / "output.txt").read_text()
    assert said.count("error:") == 1
    assert f"the head of the Ray cluster, {address}, is gone" in said
    assert "Traceback" not in said
    assert newest(tmp_path / "run").agent_steps > 0
    assert psutil.wait_procs(left, timeout=60.0)[1] == []
