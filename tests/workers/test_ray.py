"""Workers on the nodes of a Ray cluster on this machine; one cluster for all tests."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import psutil
import pytest

import ludus
from ludus.errors import ConfigError
from ludus.settings.train_config import TrainConfig
from ludus.training.hooks import Training
from ludus.training.loop import train
from tests.workers.machines import assert_equal, newest
from tests.workers.test_equal_bits import config

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
    os.environ["RAY_raylet_start_wait_time_s"] = "150"  # noqa: SIM112 - as Ray spells it
    import ray as ray_package
    from ray.cluster_utils import Cluster

    ray: Any = ray_package
    made: Any = Cluster(
        initialize_head=True, connect=True,
        head_node_args={"num_cpus": 0, "include_dashboard": False},
    )  # fmt: skip
    for _ in range(2):
        made.add_node(num_cpus=1)
    made.wait_for_nodes()
    yield made
    ray.shutdown()
    made.shutdown()


def on_ray(case: str, tmp_path: Path, **changes: Any) -> TrainConfig:
    local = config(case, tmp_path, "local:2")
    spread = replace(local, cluster="auto", num_machines=2, name="ray")
    return replace(spread, **changes)


@pytest.mark.parametrize("case", ["ppo", "sac"])
def test_two_machines_give_the_checkpoint_of_one_process(
    case: str, cluster: Any, tmp_path: Path
) -> None:
    alone = train(config(case, tmp_path, None))
    spread = train(on_ray(case, tmp_path))
    assert_equal(newest(alone.path), newest(spread.path))
    assert spread.evaluation == alone.evaluation


def test_more_machines_than_there_are_is_refused(cluster: Any, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="num_machines is 3, and the cluster has 2 machines"):
        train(on_ray("ppo", tmp_path, num_machines=3))


def test_real_games(cluster: Any, tmp_path: Path) -> None:
    run = ludus.train(
        "cartpole", cluster="auto", num_engines=1, num_worlds=4, total_steps=2048,
        evaluation_episodes=4, runs=tmp_path, name="run", progress=False,
    )  # fmt: skip
    assert run.stop_reason == "total_steps"
    assert run.evaluation["cart"].num_episodes == 4


def test_a_killed_worker_is_started_again(cluster: Any, tmp_path: Path) -> None:
    killed: list[int] = []

    def kill(_: Training) -> None:
        if not killed:
            killed.append(next(
                process.pid for process in psutil.process_iter(["cmdline"])
                if "ray::_Actor" in " ".join(process.info["cmdline"] or [])
            ))  # fmt: skip
            os.kill(killed[0], signal.SIGKILL)

    run = ludus.train(on_ray("ppo", tmp_path), on_update=kill, progress=False)
    assert run.stop_reason == "total_steps"
    assert run.metrics[-1]["restarts"] == 1
    assert "is lost" in (run.path / "train.log").read_text()
