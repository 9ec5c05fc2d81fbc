"""``ludus export``: trained policies as files for games and other runtimes."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from ludus.export.config import ExportConfig
from ludus.extras import install_hint

if TYPE_CHECKING:
    from ludus.export.compare import Comparison
    from ludus.export.exporting import Exported
    from ludus.export.parity import ParityReport

__all__ = ["COMMAND", "ExportCommand", "run"]


@dataclass(frozen=True, kw_only=True)
class ExportCommand(ExportConfig):
    """Write the trained policies of a run, or of another library, as files for games.

    A .ludus.json goes into a game, where the add-on plays it. An .onnx runs in ONNX Runtime and the
    like. Nothing is written unless all runtimes compute what was trained.
    """

    run: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="RUN")]
    is_tested: Annotated[bool, tyro.conf.arg(name="parity")] = True


COMMAND = ExportCommand


def run(command: ExportCommand) -> int:
    """Export and print; return 0."""
    for exported in _export(command):
        size = f"{exported.num_bytes / 1024:.1f} KiB"
        parity = exported.parity
        original = "ONNX Runtime" if command.run.suffix == ".onnx" else "PyTorch"
        tested = _parity_lines(parity, original) if parity else ["  not tested (--no-parity)"]
        lines = [f"{exported.policy}: {exported.path} ({size})", *tested]
        sys.stdout.write("\n".join(lines) + "\n")
    return 0


def _export(command: ExportCommand) -> list[Exported]:
    if command.run.suffix == ".zip":
        from ludus.export.sb3_export import export_model

        return [export_model(command)]
    if command.run.suffix == ".onnx":
        from ludus.export.gdrl_onnx import export_onnx

        return [export_onnx(command)]
    from ludus.export.exporting import export_policies

    return export_policies(command)


def _parity_lines(report: ParityReport, original: str) -> list[str]:
    from ludus.export.compare import TOLERANCE

    counts = f"{report.num_random} random"
    if report.num_recorded:
        counts += f" and {report.num_recorded} recorded"
    lines = [
        f"  {counts} observations; largest difference from {original}, of {TOLERANCE:g} allowed:",
        *(f"    {_line(comparison)}" for comparison in report.comparisons),
    ]
    tested = " ".join(comparison.runtime for comparison in report.comparisons)
    hints = {} if original == "ONNX Runtime" else {"ONNX Runtime": install_hint("export")}
    if "Bevy" not in tested:
        hints["Godot"] = "ludus engine install godot4"
    missing = {name: hint for name, hint in hints.items() if name not in tested}
    return lines + [f"    {name:<13} not tested ({hint})" for name, hint in missing.items()]


def _line(comparison: Comparison) -> str:
    differences = (comparison.outputs, max(comparison.continuous, comparison.discrete))
    outputs, actions = (f"{value:.1e}" if value else "0" for value in differences)
    line = f"{comparison.runtime:<13} outputs {outputs}, actions {actions}"
    if comparison.num_other_choices:
        line += f" ({comparison.num_other_choices} choices between near equals differ)"
    return line
