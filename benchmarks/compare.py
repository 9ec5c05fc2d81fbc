"""Compare Ludus with other projects in one command: `make compare`.

Brings the others into a folder beside the checkout, at fixed commits and versions, runs each
comparison of this folder in turns, and writes the tables into docs/compare.md. It needs the
network, Godot 3 and a quiet machine; with five rounds it takes about a quarter of an hour.
"""

from __future__ import annotations

import logging
import os
import platform
import re
import subprocess
import sys
import venv
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import tyro

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "compare.md"
SB3 = (
    "stable-baselines3==2.9.2", "pandas", "python-dateutil", "pytz", "six",
    "mujoco==4.0.0", "mujoco-core==4.0.0", "imageio", "pillow", "absl-py", "etils", "glfw",
    "pyopengl", "fsspec", "importlib_resources", "zipp",
)  # fmt: skip
log = logging.getLogger("compare")


@dataclass(frozen=True)
class Options:
    """Compare Ludus with other projects.

    Attributes:
        peers: Folder for the others; what is there already is used as it is.
        rounds: Rounds of each comparison; the medians count.
        only: Run these alone; the tables of the others stay.
    """

    peers: Path = ROOT.parent / "ludus-peers"
    rounds: int = 5
    only: tuple[str, ...] = ()


def main(options: Options) -> None:
    """Bring what is missing, measure, and write the page."""
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    options.peers.mkdir(parents=True, exist_ok=True)
    for name in options.only or tuple(COMPARISONS):
        log.info("%s …", name)
        table = COMPARISONS[name](options.peers.resolve(), options.rounds)
        log.info("%s", table)
        _write(name, f"{table}\n\n{_machine()}")


def _gymgodot(peers: Path, rounds: int) -> str:
    project = _clone(peers, "HugoTini/GymGodot", "2c065735e3e986d9f54ebdf611dd8e12ff449edd")
    python = peers / "gymgodot-env" / "bin" / "python"
    if not python.exists():
        venv.create(python.parents[1], with_pip=True)
        _run([python, "-m", "pip", "install", "-q", "gym==0.26.2", "websockets==10.4", "numpy<2"])
    return _measure("gymgodot.py", project, python, "--rounds", rounds)


def _godot_gym_api(peers: Path, rounds: int) -> str:
    project = _clone(
        peers, "ChernyakKonstantin/godot_gym_api", "4ee2801c7e1f12092a58b5223368f76c4d35f19b"
    )
    return _measure("godot_gym_api.py", project, "--rounds", rounds)


def _godot_rl_agents(peers: Path, rounds: int) -> str:
    project = _clone(
        peers, "edbeeching/godot_rl_agents_plugin", "bf5d6a2d7374c65ecb23cd8cdc425cac25399ec4"
    )
    return _measure("rays.py", project, "--rounds", rounds)


def _stable_baselines3(peers: Path, rounds: int) -> str:
    packages = peers / "sb3"
    if not packages.exists():
        _run(
            [sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--target", packages, *SB3]
        )
    speed = ("speed", "--rounds", rounds, "--threads", 1, "--scale", 0.5)
    return _measure("algorithms.py", *speed, path=packages)


COMPARISONS: dict[str, Callable[[Path, int], str]] = {
    "gymgodot": _gymgodot,
    "godot_gym_api": _godot_gym_api,
    "godot_rl_agents": _godot_rl_agents,
    "stable-baselines3": _stable_baselines3,
}


def _clone(peers: Path, repository: str, commit: str) -> Path:
    folder = peers / repository.rpartition("/")[2]
    if not folder.exists():
        _run(["git", "clone", "-q", f"https://github.com/{repository}", folder])
        _run(["git", "-C", folder, "checkout", "-q", commit])
    return folder


def _measure(script: str, *arguments: object, path: Path | None = None) -> str:
    """Return the tables that a benchmark prints."""
    environment = {**os.environ, **({"PYTHONPATH": str(path)} if path else {})}
    printed = _run([sys.executable, ROOT / "benchmarks" / script, *arguments], environment)
    lines = printed.splitlines()
    first = next(i for i, line in enumerate(lines) if line.startswith("|"))
    return "\n".join(lines[first:]).strip()


def _run(command: list[object], environment: dict[str, str] | None = None) -> str:
    words = [str(word) for word in command]
    return subprocess.run(
        words, check=True, stdout=subprocess.PIPE, text=True, env=environment
    ).stdout


def _machine() -> str:
    load = os.getloadavg()[0]
    return f"*{os.cpu_count()} cores, {platform.machine()}, load average {load:.1f} at the end.*"


def _write(name: str, text: str) -> None:
    """Put `text` between the markers of `name` in the page."""
    page = PAGE.read_text(encoding="utf-8")
    markers = re.compile(rf"(<!-- measured: {name} -->\n).*?(<!-- end -->)", re.DOTALL)
    PAGE.write_text(markers.sub(lambda m: f"{m[1]}{text}\n{m[2]}", page), encoding="utf-8")


if __name__ == "__main__":
    main(tyro.cli(Options))
