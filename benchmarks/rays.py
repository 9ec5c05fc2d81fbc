"""Compare rays with Godot RL Agents': what one costs, in one Godot process, in turns.

`make compare` brings its add-on (MIT), or: `git clone
https://github.com/edbeeching/godot_rl_agents_plugin PEER`; then `python benchmarks/rays.py PEER`.
"""

from __future__ import annotations

import json
import shutil
import statistics
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro

from ludus.engine import EngineKind, ensure_imported, find_engine, read_project
from ludus.engine.bundled import bundled_root

ADDON = "addons/godot_rl_agents"
MARK = "MEASURED "
MAX_DIFFERENCE = 1e-3
PROJECT = """\
config_version=5
[application]
config/name="Rays"
[physics]
3d/physics_engine="Jolt Physics"
"""


@dataclass(frozen=True)
class Options:
    """What to measure.

    Attributes:
        peer: Folder with Godot RL Agents' add-on.
        rounds: Godot processes, one after the other; the medians count.
    """

    peer: tyro.conf.Positional[Path]
    rounds: int = 5


def main(options: Options) -> None:
    """Measure, and print the table."""
    with tempfile.TemporaryDirectory(prefix="ludus-rays-") as temporary:
        project = _project(Path(temporary) / "project", options.peer)
        rounds = [_measure(project) for _ in range(options.rounds)]
    print("| 16 sensors with 16 rays | Ludus, ns a ray | Godot RL Agents, ns a ray | ratio |")
    print("|---|---|---|---|")
    for dimension, name in (("2d", "2D, 8 boxes"), ("3d", "3D (Jolt), 8 boxes")):
        found = [each[dimension] for each in rounds]
        for each in found:
            assert each["difference"] < MAX_DIFFERENCE, "they do not see the same"
            assert each["hits"] > 0.1, "they see nothing"
        ours = statistics.median(each["ours_ns"] for each in found)
        theirs = statistics.median(each["theirs_ns"] for each in found)
        ratios = sorted(each["theirs_ns"] / each["ours_ns"] for each in found)
        print(
            f"| {name} | {ours:.0f} | {theirs:.0f} "
            f"| {statistics.median(ratios):.2f} ({ratios[0]:.2f} to {ratios[-1]:.2f}) |"
        )


def _project(folder: Path, peer: Path) -> Path:
    shutil.copytree(peer / ADDON, folder / ADDON, ignore=shutil.ignore_patterns("onnx"))
    shutil.copytree(bundled_root(EngineKind.GODOT4) / "addons/ludus", folder / "addons/ludus")
    (folder / "project.godot").write_text(PROJECT)
    shutil.copy(Path(__file__).with_suffix(".gd"), folder)
    ensure_imported(find_engine(EngineKind.GODOT4), read_project(folder))
    return folder


def _measure(project: Path) -> dict[str, Any]:
    godot = str(find_engine(EngineKind.GODOT4).executable(headless=True))
    command = [godot, "--headless", "--path", str(project), "-s", "rays.gd"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=True)
    lines = [line for line in done.stdout.splitlines() if line.startswith(MARK)]
    if not lines:
        sys.exit(f"Godot measured nothing:\n{done.stdout}\n{done.stderr}")
    return json.loads(lines[0].removeprefix(MARK))


if __name__ == "__main__":
    main(tyro.cli(Options))
