"""``ludus export``: trained policies as files for games and other runtimes."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

if TYPE_CHECKING:
    from ludus.export.compare import Comparison
    from ludus.export.exporting import Exported
    from ludus.export.parity import ParityReport

__all__ = ["COMMAND", "ExportCommand", "run"]


@dataclass(frozen=True)
class ExportCommand:
    """Write the trained policies of a run as files that run without Python.

    A .ludus.json goes into a game: the add-on plays it. An .onnx runs in ONNX Runtime and the like.
    Before anything is written, all runtimes must compute what was trained.

    Attributes:
        run: Run folder, or one of its checkpoints.
        policy: Export this one only; none exports all.
        to: A file, if there is one policy; a folder; or a pattern such as models/{policy}.onnx.
            None is the run's folder, as .ludus.json.
        checkpoint: "newest", "best" (the highest mean return), or one of the run's checkpoints.
        parity: Test that the exported policy computes what was trained, in the game engine, too.
        godot: Godot to test with; none is the one that ludus finds, or the run's Bevy game.
    """

    run: tyro.conf.Positional[Path]
    policy: str | None = None
    to: str | None = None
    checkpoint: str = "newest"
    parity: bool = True
    godot: Path | None = None


COMMAND = ExportCommand


def run(command: ExportCommand) -> int:
    """Export and print; return 0."""
    from ludus.export.exporting import ExportConfig, export_policies

    config = ExportConfig(
        run=command.run,
        policy=command.policy,
        to=command.to,
        checkpoint=command.checkpoint,
        is_tested=command.parity,
        godot=command.godot,
    )
    for exported in export_policies(config):
        sys.stdout.write("\n".join(_lines(exported)) + "\n")
    return 0


def _lines(exported: Exported) -> list[str]:
    size = f"{exported.num_bytes / 1024:.1f} KiB"
    first = f"{exported.policy}: {exported.path} ({size})"
    if exported.parity is None:
        return [first, "  not tested (--no-parity)"]
    return [first, *_parity_lines(exported.parity)]


def _parity_lines(report: ParityReport) -> list[str]:
    from ludus.export.compare import TOLERANCE

    counts = f"{report.num_random} random"
    if report.num_recorded:
        counts += f" and {report.num_recorded} recorded"
    lines = [
        f"  {counts} observations; largest difference from PyTorch, of {TOLERANCE:g} allowed:",
        *(f"    {_line(comparison)}" for comparison in report.comparisons),
    ]
    tested = " ".join(comparison.runtime for comparison in report.comparisons)
    hints = {
        "ONNX Runtime": "pip install 'ludus-rl[export]'",
        "Godot": "ludus engine install godot4",
    }
    if "Bevy" in tested:
        del hints["Godot"]
    missing = {name: hint for name, hint in hints.items() if name not in tested}
    return lines + [f"    {name:<13} not tested ({hint})" for name, hint in missing.items()]


def _line(comparison: Comparison) -> str:
    actions = max(comparison.continuous, comparison.discrete)
    line = f"{comparison.runtime:<13} outputs {_figure(comparison.outputs)}"
    line += f", actions {_figure(actions)}"
    if comparison.num_other_choices:
        line += f" ({comparison.num_other_choices} choices between near equals differ)"
    return line


def _figure(difference: float) -> str:
    return f"{difference:.1e}" if difference else "0"
