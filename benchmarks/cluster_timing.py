"""How fast a run trains by the clock, and a Ray cluster on this machine to train on."""

from __future__ import annotations

import contextlib
import os
import tempfile
import time
from collections.abc import Generator, Sequence
from pathlib import Path
from typing import Any

import ludus

WARM_S = 2.0
"""Seconds at the start of each run that do not count."""


def agent_steps_per_s(seconds: float, target: str, **settings: Any) -> float:
    """Train, and return the agent-steps/s by the clock, without the start."""
    begun_s: list[float] = []
    marks: list[tuple[float, int]] = []

    def mark(training: Any) -> None:
        now = time.perf_counter()
        begun_s.append(now)
        if now - begun_s[0] > WARM_S:
            marks.append((now, training.progress.agent_steps))
            if len(marks) > 1 and now - marks[0][0] > seconds:
                training.stop()

    with tempfile.TemporaryDirectory() as runs:
        ludus.train(
            target, runs=Path(runs), name="run", total_steps=10**12, checkpoint_every_s=None,
            evaluation_episodes=0, seed=1, on_update=mark, progress=False, **settings,
        )  # fmt: skip
    first, last = marks[0], marks[-1]
    return (last[1] - first[1]) / (last[0] - first[0])


@contextlib.contextmanager
def ray_cluster(nodes: int) -> Generator[None, None, None]:
    """Start a Ray cluster on this machine: a head that plays nothing, and nodes."""
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    import ray as ray_package
    from ray.cluster_utils import Cluster

    ray: Any = ray_package
    head = {"num_cpus": 0, "include_dashboard": False}
    cluster: Any = Cluster(initialize_head=True, connect=True, head_node_args=head)
    try:
        for _ in range(nodes):
            cluster.add_node(num_cpus=1)
        cluster.wait_for_nodes()
        yield
    finally:
        ray.shutdown()
        cluster.shutdown()


def print_table(heads: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
    """Print a table in Markdown."""
    print(f"| {' | '.join(heads)} |\n|{'---|' * len(heads)}")
    for row in rows:
        print(f"| {' | '.join(map(str, row))} |")
    print(f"\n{os.cpu_count()} cores, load average {os.getloadavg()[0]:.1f} at the end", flush=True)
