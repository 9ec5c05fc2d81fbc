"""``ludus check``: does a game behave as an environment?"""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass, field
from typing import Annotated

import tyro

from ludus.check import CheckConfig, run_checks
from ludus.cli.bridge_flags import BridgeFlags
from ludus.session import LaunchOptions
from ludus.settings.checks import AT_LEAST_1, setting

__all__ = ["COMMAND", "CheckCommand", "run"]


@dataclass(frozen=True, kw_only=True)
class CheckCommand(BridgeFlags, CheckConfig):
    """Check that a game behaves as an environment: timing, seeds, determinism, observations.

    Exits with 1 if anything failed, with 0 otherwise.

    A game of a legacy bridge takes the settings of the bridge as flags, too, such as
    --action-space "Discrete(2)"; the page "Targets" of the docs lists them.

    Attributes:
        json: Print one JSON object on stdout.
    """

    target: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="TARGET")]
    num_steps: Annotated[int, tyro.conf.arg(name="steps")] = setting(300, AT_LEAST_1)
    launch: tyro.conf.Suppress[LaunchOptions] = field(default_factory=LaunchOptions)
    json: bool = False


COMMAND = CheckCommand


def run(command: CheckCommand) -> int:
    """Check and print; return 0, or 1 if something failed."""
    from rich.console import Console

    from ludus.cli.findings import FindingPrinter

    printer = FindingPrinter(Console())
    report = run_checks(command, None if command.json else printer.show)
    if command.json:
        sys.stdout.write(json.dumps(report.to_json()) + "\n")
    else:
        printer.summarise(report)
    return 0 if report.is_ok else 1
