"""Compare the cart-pole of Godot 3 with GymGodot's own Python, in turns.

Bring GymGodot beside the checkout, with the packages that it needs in an environment of their own::

    git clone https://github.com/HugoTini/GymGodot /tmp/gymgodot
    python -m venv /tmp/gymgodot-env
    /tmp/gymgodot-env/bin/pip install gym==0.26.2 websockets==10.4 "numpy<2"
    python benchmarks/gymgodot.py /tmp/gymgodot /tmp/gymgodot-env/bin/python

It needs a quiet machine. Each round measures every case once; the medians count.
"""

from __future__ import annotations

import contextlib
import os
import signal
import statistics
import subprocess
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import tyro

import ludus
from ludus.engine import EngineKind, find_engine
from ludus.pool import PoolConfig, open_pool
from ludus.spec.batch import ActionBatch

TIMEOUT_S = 120.0
WARM_UP_STEPS = 200

THEIRS = """
import sys, time
sys.path.insert(0, sys.argv[1])
from gym import spaces
from gym_server.envs.server_env import ServerEnv

if __name__ == "__main__":
    env = ServerEnv(
        serverPort="8123", exeCmd=sys.argv[2], action_space=spaces.Discrete(2),
        observation_space=spaces.Box(-1.0, 1.0, (4,)), window_render=False,
    )
    env.reset()
    num_steps, warm_up = int(sys.argv[3]), int(sys.argv[4])
    for number in range(num_steps + warm_up):
        if number == warm_up:
            start = time.perf_counter()
        if env.step(number % 2)[2]:
            env.reset()
    print("steps/s", num_steps / (time.perf_counter() - start))
    env.close()
"""


@dataclass(frozen=True)
class Options:
    """What to measure.

    Attributes:
        peer: Checkout of GymGodot.
        python: Python that has its packages.
        rounds: Times that each case is measured.
        steps: Steps of a round with one environment.
    """

    peer: tyro.conf.Positional[Path]
    python: tyro.conf.Positional[Path]
    rounds: int = 5
    steps: int = 10_000


def command(peer: Path) -> str:
    """Return what the shell runs to start GymGodot's cart-pole."""
    godot = find_engine(EngineKind.GODOT3).executable(headless=True)
    return f"cd {peer.absolute() / 'gym-godot'} && {godot} ./examples/cartpole/Root.tscn"


def their_rate(options: Options) -> float:
    """Step GymGodot's own class, in a process of its own."""
    arguments = [str(options.peer.absolute() / "gym-server"), command(options.peer)]
    numbers = [str(options.steps), str(WARM_UP_STEPS)]
    with subprocess.Popen(
        [options.python, "-c", THEIRS, *arguments, *numbers],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        start_new_session=True,
    ) as process:
        try:
            output, _ = process.communicate(timeout=TIMEOUT_S)
        finally:
            # It waits for ever for a game that has quit, and leaves the game behind.
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
    return float(output.split("steps/s")[1].split()[0])


def bridge_rate(options: Options) -> float:
    """Step the same unmodified project through ``ludus/GymGodot-v0``."""
    env: Any = gymnasium.make(
        "ludus/GymGodot-v0",
        serverPort=0,
        exeCmd=command(options.peer),
        action_space=gymnasium.spaces.Discrete(2),
        observation_space=gymnasium.spaces.Box(-np.inf, np.inf, (4,)),
        disable_env_checker=True,
    )
    rate = env_rate(env, options.steps)
    env.close()
    return rate


def single_rate(options: Options) -> float:
    """Step one world of our scene through ``gymnasium.Env``."""
    env: Any = ludus.make("godot3:cartpole")
    rate = env_rate(env, options.steps)
    env.close()
    return rate


def env_rate(env: Any, num_steps: int) -> float:
    """Return the steps per second of a ``gymnasium.Env``."""
    env.reset()
    start = 0.0
    for number in range(num_steps + WARM_UP_STEPS):
        if number == WARM_UP_STEPS:
            start = time.perf_counter()
        _, _, terminated, truncated, _ = env.step(number % 2)
        if terminated or truncated:
            env.reset()
    return num_steps / (time.perf_counter() - start)


def many_rate(options: Options) -> float:
    """Step 64 worlds in each of two engines; agent-steps per second."""
    num_steps = max(200, options.steps // 10)
    with open_pool("godot3:cartpole", PoolConfig(num_worlds=64, num_engines=2)) as pool:
        pool.reset(0)
        num_agents = pool.num_agents("cart")
        start = 0.0
        for number in range(num_steps + WARM_UP_STEPS):
            if number == WARM_UP_STEPS:
                start = time.perf_counter()
            discrete = np.full((num_agents, 1), number % 2)
            pool.step({"cart": ActionBatch(discrete, np.zeros((num_agents, 0), np.float32))})
        return num_steps * num_agents / (time.perf_counter() - start)


CASES: dict[str, Callable[[Options], float]] = {
    "GymGodot": their_rate,
    "Ludus, GymGodot's unmodified project": bridge_rate,
    "Ludus, godot3:cartpole, one environment": single_rate,
    "Ludus, godot3:cartpole, 64 worlds × 2 engines": many_rate,
}


def main(options: Options) -> None:
    """Measure all cases in turns and print a table."""
    rates: dict[str, list[float]] = {name: [] for name in CASES}
    for _ in range(options.rounds):
        for name, measure in CASES.items():
            rates[name].append(measure(options))
    base = statistics.median(rates["GymGodot"])
    print("| | steps/s, median | least to most | ratio |\n|---|---|---|---|")
    for name, each in rates.items():
        middle = statistics.median(each)
        spread = f"{min(each):,.0f} to {max(each):,.0f}"
        print(f"| {name} | {middle:,.0f} | {spread} | {middle / base:.2f} |")


if __name__ == "__main__":
    main(tyro.cli(Options))
