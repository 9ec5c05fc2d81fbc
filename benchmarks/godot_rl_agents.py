"""The examples of Godot RL Agents, trained four ways, in turns: rounds a second.

Bring them and their Python beside the checkout, then::

    git clone https://github.com/edbeeching/godot_rl_agents_examples /tmp/examples
    python3 -m venv /tmp/gdrl && /tmp/gdrl/bin/pip install godot-rl==0.8.2
    python benchmarks/godot_rl_agents.py /tmp/examples /tmp/gdrl/bin/python

A round is one action of every agent, drawn at random, for eight ticks. Each example is played in
its main scene by its own Python as its readme starts it (``--speedup 8``, and no ``--fixed-fps``
that Godot understands) and with that flag corrected, both with observations made into arrays, as
all of its trainers do; by ``gdrl:``; and with our ``sync.gd`` in the place of its own, in one
process and in two. Rounds of two processes count twice.
"""

from __future__ import annotations

import logging
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import tyro

import ludus
from ludus.engine import EngineKind, InstalledEngine, ensure_imported, find_engine, read_project
from ludus.errors import LudusError
from ludus.legacy.addon import install_legacy_addon
from ludus.play.random_actions import RandomActions
from ludus.pool import PoolConfig
from ludus.pool.interface import Pool

ACTION_REPEAT = 8
EXAMPLES = {
    "AirHockey": "", "BallChase": "", "CrossTheRoad": "Completed", "DefendTheGoal": "",
    "DownFall": "", "FPS": "", "FlyBy": "", "ItemSortingCart": "", "JumperHard": "",
    "MultiAgentSimple": "", "Racer": "", "RobotFPS": "", "ScoreTheGoal": "",
    "TestExamples/SimpleReachGoal": "GDScript", "TestExamples/SimpleMemoryTest": "",
}  # fmt: skip
"""Folder of the project in that of the example."""
THEIR_FPS = ("--fixed-fps", "60")
THEIR_ROUNDS = """
import subprocess, sys, time
import numpy as np
from godot_rl.core.godot_env import GodotEnv

command, seconds = sys.argv[2:], float(sys.argv[1])

class Env(GodotEnv):
    def _set_platform_suffix(self, path):
        return path
    def check_platform(self, path):
        pass
    def _launch_env(self, path, port, *_, **__):
        self.proc = subprocess.Popen([*command, f"--port={port}"], start_new_session=True,
                                     stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

env = Env("game", convert_action_space=False)
env.reset()
rows = {}
for row, policy in enumerate(env.agent_policy_names):
    rows.setdefault(policy, []).append(row)

def play():
    drawn = [space.sample() for space in env.tuple_action_spaces]
    observations, rewards, *_ = env.step(drawn, order_ij=True)
    for own in rows.values():
        {key: np.array([observations[row][key] for row in own]) for key in observations[own[0]]}
    np.array(rewards, np.float32)

for _ in range(20):
    play()
count, began = 0, time.perf_counter()
while time.perf_counter() - began < seconds:
    play()
    count += 1
print("rounds", count / (time.perf_counter() - began))
env.close()
"""
log = logging.getLogger("godot_rl_agents")


@dataclass(frozen=True)
class Options:
    """What to measure.

    Attributes:
        examples: Checkout of godot_rl_agents_examples.
        python: Python with godot-rl.
        only: These examples alone.
        turns: Times that each way is measured; the medians count.
        seconds: How long each is played.
    """

    examples: tyro.conf.Positional[Path]
    python: tyro.conf.Positional[Path]
    only: tuple[str, ...] = ()
    turns: int = 3
    seconds: float = 5.0


def measure_theirs(command: list[str], options: Options) -> float:
    """Return the rounds a second of their Python."""
    done = subprocess.run(
        [options.python, "-c", THEIR_ROUNDS, str(options.seconds), *command],
        capture_output=True, text=True, timeout=90 + 4 * options.seconds, check=False,
    )  # fmt: skip
    for line in done.stdout.splitlines():
        if line.startswith("rounds "):
            return float(line.removeprefix("rounds "))
    raise RuntimeError(done.stderr.strip().splitlines()[-1:] or "no answer")


def measure_ours(target: str, config: PoolConfig, options: Options) -> float:
    """Return the rounds a second of a pool; those of all its engines count."""
    with ludus.open_pool(target, config) as pool:
        play(pool, 2.0)
        return pool.num_engines * play(pool, options.seconds)


def play(pool: Pool, seconds: float) -> float:
    """Take random actions; return the steps a second."""
    player = RandomActions(pool.spec, range(pool.num_engines * pool.spec.num_worlds))
    batches = pool.reset(seed=0)
    count, began = 0, time.perf_counter()
    while time.perf_counter() - began < seconds:
        batches = pool.step(player.act(batches))
        count += 1
    return count / (time.perf_counter() - began)


def make_ways(
    project: Path, folder: Path, engine: InstalledEngine, options: Options
) -> dict[str, Callable[[], float]]:
    """Return what measures each way, in copies of a project."""
    theirs, ours = folder / "theirs", folder / "ours"
    for copy in (theirs, ours):
        shutil.copytree(project, copy)
    install_legacy_addon(ours)
    for copy in (theirs, ours):
        ensure_imported(engine, read_project(copy))
    start = [str(engine.executable(headless=True)), "--path", str(theirs), "--headless"]
    own = ["--disable-render-loop", "--env_seed=0", f"--action_repeat={ACTION_REPEAT}"]
    wire = PoolConfig(bridge={"action_repeat": ACTION_REPEAT})
    classes = PoolConfig(ticks_per_step=ACTION_REPEAT)
    return {
        "as started": partial(measure_theirs, [*start, *own, "--speedup=8"], options),
        "corrected": partial(measure_theirs, [*start, *THEIR_FPS, *own, "--speedup=1"], options),
        "gdrl:": partial(measure_ours, f"gdrl:{theirs}", wire, options),
        "our classes": partial(measure_ours, str(ours), classes, options),
        "our classes, 2 processes": partial(
            measure_ours, str(ours), replace(classes, num_engines=2), options
        ),
    }


def main(options: Options) -> None:
    """Print a row for each example."""
    logging.basicConfig(level=logging.INFO, format="%(message)s", stream=sys.stderr)
    engine = find_engine(EngineKind.GODOT4)
    is_first = True
    for example, inner in EXAMPLES.items():
        name = Path(example).name
        if options.only and name not in options.only:
            continue
        found = list(options.examples.rglob(f"{example}/{inner}".rstrip("/") + "/project.godot"))
        if not found:
            log.warning("%s is not there", name)
            continue
        with tempfile.TemporaryDirectory() as temporary:
            ways = make_ways(found[0].parent, Path(temporary), engine, options)
            rates: dict[str, list[float]] = {way: [] for way in ways}
            for turn in range(options.turns):
                for way, measure in ways.items():
                    try:
                        rates[way].append(measure())
                    except (LudusError, RuntimeError, subprocess.TimeoutExpired) as error:
                        log.warning("%s, %s, turn %d: %s", name, way, turn + 1, error)
        if is_first:
            print(f"| example | {' | '.join(ways)} |\n|---{'|---' * len(ways)}|")
            is_first = False
        cells = [f"{statistics.median(each):.0f}" if each else "–" for each in rates.values()]
        print(f"| {name} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main(tyro.cli(Options, description=__doc__))
