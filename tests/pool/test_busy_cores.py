"""Beside programs that keep the cores busy, waiting costs no more than sleeping does."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from statistics import median

import numpy as np
import pytest

from ludus.engine.affinity import allowed_cores
from ludus.pool import PoolConfig, open_pool
from ludus.pool.opening import DEFAULT_SPIN_US
from ludus.spec.batch import ActionBatch

pytestmark = [pytest.mark.engine, pytest.mark.alone, pytest.mark.timeout(300, func_only=True)]

FEWEST_ROUNDS, MOST_ROUNDS = 3, 12
SECONDS = 0.5


@pytest.fixture
def busy_cores() -> Iterator[None]:
    """Processes that want all cores but one."""
    count = max(1, len(allowed_cores() or (0, 1)) - 1)
    command = [sys.executable, "-c", "while True: pass"]
    processes = [subprocess.Popen(command) for _ in range(count)]
    yield
    for process in processes:
        process.kill()
        process.wait()


@pytest.mark.usefixtures("busy_cores")
@pytest.mark.parametrize(
    "target",
    ["cartpole", "godot3:cartpole", pytest.param("bevy:cartpole", marks=pytest.mark.bevy)],
)
def test_looking_without_sleeping_costs_little_where_cores_are_busy(target: str) -> None:
    # Looking regardless made a third of the steps, or less. What else keeps the cores busy may hit
    # either side of a round, hence further rounds, and medians: one lucky round settles nothing.
    asleep: list[float] = []
    awake: list[float] = []
    while len(asleep) < FEWEST_ROUNDS or median(awake) <= 0.5 * median(asleep):
        assert len(asleep) < MOST_ROUNDS, (asleep, awake)
        asleep.append(steps_per_s(target, 0))
        awake.append(steps_per_s(target, DEFAULT_SPIN_US))


def steps_per_s(target: str, spin_us: int) -> float:
    with open_pool(target, PoolConfig(spin_us=spin_us)) as pool:
        pool.reset(0)
        action = ActionBatch(np.zeros((1, 1), np.int64), np.zeros((1, 0), np.float32))
        num_steps, start = 0, time.perf_counter()
        while time.perf_counter() < start + SECONDS:
            pool.step({"cart": action})
            num_steps += 1
        return num_steps / (time.perf_counter() - start)
