"""Compare our Python, scripts and add-on for Godot 3 with godot_gym_api's, in turns.

Bring godot_gym_api beside the checkout; its Python runs in ours, which has what it needs::

    git clone https://github.com/ChernyakKonstantin/godot_gym_api /tmp/godot_gym_api
    python benchmarks/godot_gym_api.py /tmp/godot_gym_api

All step a robot that looks for an apple, four physics frames a step: its own game, answering in
protobuf with all that agent and world have, and `godot3:apple_seeker`, the same task for our
add-on. It needs a quiet machine. Each round measures every case once; the medians count.

``--blocks 100`` compares the scripts alone, and on a busy machine, too: the game with its scripts
and the game with ours run side by side and play blocks of 100 steps in turns.
"""

from __future__ import annotations

import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import tyro

import ludus
from ludus.engine import EngineKind, ensure_imported, find_engine, read_project
from ludus.legacy.addon import install_legacy_addon
from ludus.legacy.godot_gym_api import GodotClient
from ludus.pool import PoolConfig, open_pool
from ludus.spec.batch import ActionBatch

ADDRESS = ("127.0.0.1", 9090)
ALL: dict[str, list[str]] = {"agent": [], "world": []}
EPISODE_STEPS = 500
NUM_WORLDS = 64
WARM_UP_STEPS = 200
BLOCK_STEPS = 100


@dataclass(frozen=True)
class Options:
    """What to measure.

    Attributes:
        peer: Checkout of godot_gym_api.
        rounds: Times that each case is measured.
        steps: Steps of a round with one environment.
        blocks: Number of blocks in which only the scripts are compared; 0 measures all cases.
    """

    peer: tyro.conf.Positional[Path]
    rounds: int = 7
    steps: int = 5_000
    blocks: int = 0


@dataclass(frozen=True)
class Games:
    """The game of godot_gym_api, with its scripts and with ours, and what its answers are."""

    theirs: Path
    ours: Path
    messages: Any


def make_games(peer: Path, folder: Path) -> Games:
    """Copy the game twice, with its add-on; put our scripts into the second."""
    projects = {name: folder / name for name in ("theirs", "ours")}
    for project in projects.values():
        shutil.copytree(peer / "examples/apple_seeker/godot", project)
        shutil.copytree(peer / "godot_addon", project / "addons", dirs_exist_ok=True)
    install_legacy_addon(projects["ours"])
    for project in projects.values():
        ensure_imported(find_engine(EngineKind.GODOT3), read_project(project))
    return Games(**projects, messages=import_module("message_pb2"))


@contextmanager
def running(project: Path, port: int = ADDRESS[1]) -> Generator[None]:
    """Run a game as fast as it can; nobody else may listen at its port, which ours alone choose."""
    godot = find_engine(EngineKind.GODOT3).executable(headless=True)
    flags = ["--fixed-fps", "60", "--disable-render-loop", f"--ludus-port={port}"]
    process = subprocess.Popen([godot, *flags, "--path", project], stdout=subprocess.DEVNULL)
    try:
        yield
    finally:
        process.kill()
        process.wait()


def client_rate(make_client: Callable[..., Any], messages: Any, game: Path, num: int) -> float:
    """Step a game for godot_gym_api through ``GodotClient``, theirs or ours."""
    with running(game):
        client = make_client(messages, ADDRESS)

        def step(number: int) -> None:
            if number % EPISODE_STEPS == 0:
                client.reset(ALL)
            client.step(number // 5 % 4, ALL)

        rate = steps_per_s(step, num)
        if isinstance(client, GodotClient):
            client.close()
        else:
            client.connection.close()
    return rate


def compare_scripts(games: Games, make_client: Callable[..., Any], num_blocks: int) -> list[float]:
    """Return how long a step takes with their scripts and with ours, microseconds.

    Of the blocks the fastest tenth counts, which other programs disturb least.
    """
    host, port = ADDRESS
    with running(games.theirs, port), running(games.ours, port + 1):
        clients = [make_client(games.messages, (host, port + i)) for i in range(2)]
        times: list[list[float]] = [[], []]
        for block in range(num_blocks):
            for i in (0, 1) if block % 2 else (1, 0):
                clients[i].reset(ALL)
                start = time.perf_counter()
                for number in range(BLOCK_STEPS):
                    clients[i].step(number // 5 % 4, ALL)
                times[i].append(time.perf_counter() - start)
    return [statistics.quantiles(each, n=10)[0] / BLOCK_STEPS * 1e6 for each in times]


def single_rate(num: int) -> float:
    """Step one world of our scene through ``gymnasium.Env``."""
    env: Any = ludus.make("godot3:apple_seeker")
    env.reset()

    def step(number: int) -> None:
        _, _, terminated, truncated, _ = env.step(number // 5 % 4)
        if terminated or truncated:
            env.reset()

    rate = steps_per_s(step, num)
    env.close()
    return rate


def many_rate(num_engines: int, num: int) -> float:
    """Step 64 worlds in each engine; agent-steps per second."""
    config = PoolConfig(num_worlds=NUM_WORLDS, num_engines=num_engines)
    with open_pool("godot3:apple_seeker", config) as pool:
        pool.reset(0)
        num_agents = pool.num_agents("robot")
        floats = np.zeros((num_agents, 0), np.float32)

        def step(number: int) -> None:
            choices = np.full((num_agents, 1), number // 5 % 4)
            pool.step({"robot": ActionBatch(choices, floats)})

        return steps_per_s(step, max(200, num // 10)) * num_agents


def steps_per_s(step: Callable[[int], None], num: int) -> float:
    """Return how many steps are made in a second, once it is warm."""
    for number in range(WARM_UP_STEPS):
        step(number)
    start = time.perf_counter()
    for number in range(WARM_UP_STEPS, WARM_UP_STEPS + num):
        step(number)
    return num / (time.perf_counter() - start)


def cases(games: Games) -> dict[str, Callable[[int], float]]:
    """Return what is measured, by name; the first is what the others are compared with."""
    theirs: Any = import_module("godot_gym_api").GodotClient
    through_theirs = partial(client_rate, theirs, games.messages)
    through_ours = partial(client_rate, GodotClient, games.messages)
    return {
        "its Python, its scripts": partial(through_theirs, games.theirs),
        "our Python, its scripts": partial(through_ours, games.theirs),
        "its Python, our scripts": partial(through_theirs, games.ours),
        "our Python, our scripts": partial(through_ours, games.ours),
        "`godot3:apple_seeker`, one environment": single_rate,
        f"`godot3:apple_seeker`, {NUM_WORLDS} worlds": partial(many_rate, 1),
        f"`godot3:apple_seeker`, {NUM_WORLDS} worlds in each of two engines": partial(many_rate, 2),
    }


def main(options: Options) -> None:
    """Measure all cases in turns and print a table."""
    sys.path[:0] = [
        str(options.peer / "python"),
        str(options.peer / "examples/apple_seeker/python"),
    ]
    with tempfile.TemporaryDirectory() as folder:
        games = make_games(options.peer, Path(folder))
        if options.blocks:
            theirs: Any = import_module("godot_gym_api").GodotClient
            print("| | its scripts, µs | our scripts, µs | ratio of speeds |\n|---|---|---|---|")
            for name, client in {"its Python": theirs, "our Python": GodotClient}.items():
                one, other = compare_scripts(games, client, options.blocks)
                print(f"| {name} | {one:.0f} | {other:.0f} | {one / other:.2f} |")
            return
        measured = cases(games)
        rates: dict[str, list[float]] = {name: [] for name in measured}
        for _ in range(options.rounds):
            for name, measure in measured.items():
                rates[name].append(measure(options.steps))
    base = statistics.median(next(iter(rates.values())))
    print("| | steps/s, median | least to most | ratio |\n|---|---|---|---|")
    for name, each in rates.items():
        middle = statistics.median(each)
        spread = f"{min(each):,.0f} to {max(each):,.0f}"
        print(f"| {name} | {middle:,.0f} | {spread} | {middle / base:.2f} |")


if __name__ == "__main__":
    main(tyro.cli(Options))
