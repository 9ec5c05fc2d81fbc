"""Agent-steps/s of several processes together, each with a pool of its own.

    python benchmarks/processes.py --processes 2 4

Measures in turns: engines pinned to cores that the processes agree on (the default), and left to
the system (``is_pinned=False``). Needs a quiet machine.
"""

from __future__ import annotations

import multiprocessing
import os
import statistics
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
import tyro

import ludus

WARM_UP_S = 1.5
"""Longer than it takes pools to notice that others share their cores."""


@dataclass
class Config:
    """What is measured.

    Attributes:
        processes: Numbers of processes side by side.
        target: The game.
        worlds: Of each process, in one engine.
        turns: How often each is measured; the median counts.
        seconds: Of each turn.
    """

    processes: tuple[int, ...] = (1, 2, 4)
    target: str = "cartpole"
    worlds: int = 64
    turns: int = 5
    seconds: float = 3.0


def step_for(config: Config, is_pinned: bool, barrier: Any, rates: Any) -> None:
    """Step a game beside the others; hand over its agent-steps/s."""
    envs: Any = ludus.make_vec(config.target, num_worlds=config.worlds, is_pinned=is_pinned)
    envs.reset(seed=0)
    actions = np.zeros_like(envs.action_space.sample())

    def rate(seconds: float) -> float:
        start, steps = time.perf_counter(), 0
        while time.perf_counter() - start < seconds:
            envs.step(actions)
            steps += envs.num_envs
        return steps / (time.perf_counter() - start)

    barrier.wait()
    rate(WARM_UP_S)
    rates.put(rate(config.seconds))
    barrier.wait()  # nobody ends an engine while others measure
    envs.close()


def measure(config: Config, num: int, is_pinned: bool) -> float:
    """Return the agent-steps/s of ``num`` processes together."""
    context = multiprocessing.get_context("spawn")
    barrier, rates = context.Barrier(num), context.Queue()
    arguments = (config, is_pinned, barrier, rates)
    children = [context.Process(target=step_for, args=arguments) for _ in range(num)]
    for child in children:
        child.start()
    total = sum(rates.get(timeout=120) for _ in children)
    for child in children:
        child.join()
    return total


def main(config: Config) -> None:
    """Print a line for each number of processes."""
    print(f"{config.target}, {config.worlds} worlds each, {os.cpu_count()} cores")
    for num in config.processes:
        pairs = [
            (measure(config, num, True), measure(config, num, False)) for _ in range(config.turns)
        ]
        pinned, free = (statistics.median(column) for column in zip(*pairs, strict=True))
        ratio = statistics.median(one / other for one, other in pairs)
        print(f"{num} processes: pinned {pinned:,.0f}, not {free:,.0f} steps/s; ratio {ratio:.2f}")


if __name__ == "__main__":
    main(tyro.cli(Config))
