"""How many seeds reach a return: `ludus train` once per seed, one after the other.

    python benchmarks/seeds.py path/to/player.tscn --goal 460 --total-steps 300000

Flags that are not listed by `--help` go to `ludus train`.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro


@dataclass(frozen=True)
class Options:
    """What to train.

    Attributes:
        target: Anything `ludus train` takes.
        goal: Mean return that every policy's evaluation must reach.
        seeds: Seeds of the runs.
    """

    target: tyro.conf.Positional[str]
    goal: float
    seeds: tuple[int, ...] = tuple(range(1, 21))


def train(target: str, seed: int, flags: list[str], runs: Path) -> dict[str, Any]:
    """Train in a process of its own; return the run's `result.json`."""
    name = f"seed-{seed}"
    command = [sys.executable, "-m", "ludus", "train", target, "--seed", str(seed),
               "--runs", str(runs), "--name", name, *flags]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(f"{' '.join(command)}\n{done.stderr}")
    return json.loads((runs / name / "result.json").read_text())


def main() -> None:
    """Print a line per seed and how many reached the goal."""
    options, flags = tyro.cli(Options, description=__doc__, return_unknown_args=True)
    print(f"{'seed':>12} {'steps':>10} {'seconds':>8}  mean return", flush=True)
    num_reached = 0
    with tempfile.TemporaryDirectory() as runs:
        for seed in options.seeds:
            result = train(options.target, seed, flags, Path(runs))
            returns: dict[str, float] = result["evaluation"]
            num_reached += bool(returns) and min(returns.values()) >= options.goal
            told = "  ".join(f"{name} {value:.4g}" for name, value in returns.items())
            steps, seconds = result["agent_steps"], result["wall_s"]
            print(f"{seed:>12} {steps:>10,} {seconds:>8.1f}  {told or 'none'}", flush=True)
    print(f"{num_reached} of {len(options.seeds)} seeds reached {options.goal:g}")


if __name__ == "__main__":
    main()
