"""How speed grows with the number of workers, in a game that spends its time waiting."""

from __future__ import annotations

import contextlib
import os
import statistics
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from cluster_games import SLEEP_MS
from cluster_timing import agent_steps_per_s, print_table, ray_cluster

from ludus.addon.new_project import ProjectKind, make_project


@dataclass(frozen=True)
class Scaling:
    """Train with a growing number of workers whose game sleeps.

    Attributes:
        rounds: Runs of each size, in turns; medians count.
        seconds: Of each run.
        workers: How many.
        game: gym (`Sleeping-v0`) or godot (a project that sleeps in each physics tick).
        sleep_ms: Of each step; none: 5, or as much as `fitting` workers need to take half of the
            cores.
        fitting: See `sleep_ms`; more workers than twice as many cannot scale on these cores.
        cluster: Worker processes, or nodes of a Ray cluster on this machine.
    """

    rounds: int = 2
    seconds: float = 6.0
    workers: tuple[int, ...] = (1, 2, 4, 8, 16, 32)
    game: Literal["gym", "godot"] = "gym"
    sleep_ms: float | None = None
    fitting: int = 16
    cluster: Literal["local", "ray"] = "local"


def measure_scaling(options: Scaling) -> None:
    """Print agent-steps/s by the number of workers, and their share of perfect scaling."""
    with tempfile.TemporaryDirectory() as folder:
        target = "gym:cluster_games:Sleeping-v0"
        if options.game == "godot":
            target = str(_sleeping_game(Path(folder) / "sleeping"))
        os.environ[SLEEP_MS] = "0"
        step_ms = 1000 / agent_steps_per_s(2.0, target, **_one_world(), cluster="local:1")
        cores = os.cpu_count() or 1
        sleep_ms = options.sleep_ms
        if sleep_ms is None:
            sleep_ms = max(5.0, step_ms * options.fitting / (0.5 * cores))
        os.environ[SLEEP_MS] = f"{sleep_ms:.3f}"
        print(
            f"a step without sleep takes {step_ms:.2f} ms; sleep is {sleep_ms:.1f} ms", flush=True
        )
        nodes = max(options.workers)
        with ray_cluster(nodes) if options.cluster == "ray" else contextlib.nullcontext():
            _print_scaling(options, target)


def _print_scaling(options: Scaling, target: str) -> None:
    speeds: dict[int, list[float]] = {num: [] for num in options.workers}
    for _ in range(options.rounds):
        for num, of in speeds.items():
            cluster: dict[str, Any] = {"cluster": f"local:{num}"}
            if options.cluster == "ray":
                cluster = {"cluster": "auto", "num_machines": num}
            of.append(agent_steps_per_s(options.seconds, target, **_one_world(), **cluster))
            print(f"{num} workers: {of[-1]:,.1f}", flush=True)
    first = statistics.median(speeds[options.workers[0]]) / options.workers[0]
    rows = [
        [num, f"{statistics.median(of):,.0f}", f"{statistics.median(of) / num / first:.3f}",
         f"{min(of):,.0f} to {max(of):,.0f}"]
        for num, of in speeds.items()
    ]  # fmt: skip
    print_table(["workers", "agent-steps/s", "weak scaling", "of rounds"], rows)


def _one_world() -> dict[str, Any]:
    return {"num_worlds": 1, "num_engines": 1, "is_pinned": False}


def _sleeping_game(folder: Path) -> Path:
    """Make a project whose physics ticks sleep as long as the environment variable says."""
    make_project(folder, ProjectKind.TWO_D)
    (folder / "sleep.gd").write_text(
        "extends Node\n\n\nfunc _physics_process(_delta: float) -> void:\n"
        f'\tOS.delay_usec(int(float(OS.get_environment("{SLEEP_MS}")) * 1000.0))\n'
    )
    with (folder / "project.godot").open("a") as settings:
        settings.write('\n[autoload]\n\nSleep="*res://sleep.gd"\n')
    return folder
