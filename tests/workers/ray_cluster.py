"""A Ray cluster of several nodes on this machine, and what runs on it."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import psutil
import pytest

from ludus.settings.train_config import PPOConfig, TrainConfig
from tests.workers.test_equal_bits import config

__all__ = ["actors", "add_node", "cluster", "large_rollout", "on_ray", "require_no_actors"]


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


def actors(cluster: Any) -> list[psutil.Process]:
    """Return the processes of workers on the nodes of a cluster, oldest first."""
    found = [
        process for process in psutil.process_iter(["cmdline", "create_time"])
        if "ray::_Actor" in " ".join(process.info["cmdline"] or [])
        and (node := process.parent()) is not None
        and cluster.address in " ".join(node.cmdline())
    ]  # fmt: skip
    return sorted(found, key=lambda process: process.info["create_time"])


def require_no_actors(cluster: Any) -> None:
    """Require that no worker is left; Ray ends them soon after it is told to."""
    assert psutil.wait_procs(actors(cluster), timeout=30.0)[1] == []


def large_rollout(tmp_path: Path) -> TrainConfig:
    """One rollout of 229 MB; a node keeps 157 MB in memory."""
    ppo = PPOConfig(hidden_sizes=(8,), rollout_steps=64, epochs=1, minibatch_size=1024)
    return TrainConfig(
        "gym:tests.workers.environments:Wide-v0", cluster="auto", num_machines=1, num_engines=1,
        num_worlds=32, total_steps=32 * 64, seed=1, ppo=ppo, runs=tmp_path, name="run",
        evaluation_episodes=0,
    )  # fmt: skip
