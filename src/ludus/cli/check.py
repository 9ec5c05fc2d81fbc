"""``ludus check``: does a game behave as an environment?"""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path

import tyro

__all__ = ["COMMAND", "CheckCommand", "run"]


@dataclass(frozen=True)
class CheckCommand:
    """Check that a game behaves as an environment: timing, seeds, determinism, observations.

    Exits with 0 if nothing failed, with 1 if something did.

    Attributes:
        target: A bundled example, a project folder, a scene, or an exported game.
        scene: Scene of the project, such as res://level.tscn; none is its main scene.
        num_worlds: Worlds to play in.
        steps: Steps of random play.
        seed: Seed of world 0 and of its actions.
        json: Print one JSON object on stdout.
        godot: Engine to use; none is the one that ludus finds.
    """

    target: tyro.conf.Positional[str]
    scene: str | None = None
    num_worlds: int = 4
    steps: int = 300
    seed: int = 0
    json: bool = False
    godot: Path | None = None


COMMAND = CheckCommand


def run(command: CheckCommand) -> int:
    """Check and print; return 0, or 1 if something failed."""
    from rich.console import Console

    from ludus.check import CheckConfig, run_checks
    from ludus.cli.findings import FindingPrinter

    config = CheckConfig(
        target=command.target,
        scene=command.scene,
        num_worlds=command.num_worlds,
        num_steps=command.steps,
        seed=command.seed,
        godot=command.godot,
    )
    printer = FindingPrinter(Console())
    report = run_checks(config, None if command.json else printer.show)
    if command.json:
        sys.stdout.write(json.dumps(report.to_json()) + "\n")
    else:
        printer.summarise(report)
    return 0 if report.is_ok else 1
