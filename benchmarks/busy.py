"""Steps a second while other programs want the same cores.

    python benchmarks/busy.py cartpole --worlds 64

Measures in turns, beside no busy process, beside one and so on: with both sides looking for the
next message before they sleep, as pools do of their own, and sleeping at once (`spin_us=0`).
"""

from __future__ import annotations

import statistics
import subprocess
import sys
import time
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import tyro

from ludus.pool import PoolConfig, open_pool
from ludus.spec.batch import ActionBatch

WARM_UP_STEPS = 200


@dataclass(frozen=True)
class Options:
    """What to measure.

    Attributes:
        target: Target with one policy.
        worlds: Worlds of the one engine.
        busy: Largest number of busy processes.
        rounds: Times that each case is measured.
        seconds: Length of a measurement.
    """

    target: tyro.conf.Positional[str]
    worlds: int = 1
    busy: int = 2
    rounds: int = 5
    seconds: float = 2.0


@contextmanager
def busy_processes(count: int) -> Generator[None]:
    """Keep so many cores busy."""
    processes = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()


def rate(options: Options, spin_us: int | None) -> float:
    """Return agent-steps per second of one engine; the first choice of all, zeros else."""
    config = PoolConfig(num_worlds=options.worlds, spin_us=spin_us)
    with open_pool(options.target, config) as pool:
        pool.reset(0)
        ((name, policy),) = pool.policies.items()
        num = pool.num_agents(name)
        discrete = np.zeros((num, policy.num_discrete), np.int64)
        actions = {name: ActionBatch(discrete, np.zeros((num, policy.continuous_size), np.float32))}
        for _ in range(WARM_UP_STEPS):
            pool.step(actions)
        num_steps, start = 0, time.perf_counter()
        while time.perf_counter() < start + options.seconds:
            pool.step(actions)
            num_steps += 1
        return num_steps * num / (time.perf_counter() - start)


def main(options: Options) -> None:
    """Measure all cases in turns and print a table."""
    cases: dict[str, int | None] = {"as usual": None, "`spin_us=0`": 0}
    rates: dict[tuple[int, str], list[float]] = {}
    for _ in range(options.rounds):
        for count in range(options.busy + 1):
            with busy_processes(count):
                for name, spin_us in cases.items():
                    rates.setdefault((count, name), []).append(rate(options, spin_us))
    print("| busy processes | | agent-steps/s, median | least to most |\n|---|---|---|---|")
    for (count, name), each in rates.items():
        spread = f"{min(each):,.0f} to {max(each):,.0f}"
        print(f"| {count} | {name} | {statistics.median(each):,.0f} | {spread} |")


if __name__ == "__main__":
    main(tyro.cli(Options))
