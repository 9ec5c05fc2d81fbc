"""``ludus cluster``: check the machines of a Ray cluster before a run needs them."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from ludus.settings.checks import ABOVE_0, AT_LEAST_1, setting
from ludus.settings.pool_config import GameConfig

if TYPE_CHECKING:
    from rich.table import Table

    from ludus.workers.node_check import NodeReport

__all__ = ["COMMAND", "ClusterCommand", "run"]


@dataclass(frozen=True, kw_only=True)
class ClusterCommand(GameConfig):
    """Check that a game plays on every machine of a Ray cluster, and how fast.

    Compares versions of Ludus, Python and engines, measures the network to this machine, and lets
    all machines play a few seconds with random actions. Exits with 1 if a run could not play on one
    of them. It needs the extra cluster.

    Attributes:
        action: What to do.
        target: The game.
        cluster: auto, or HOST:PORT of the head.
        seconds: How long each machine plays.
        json: Print one JSON list on stdout.
    """

    action: tyro.conf.Positional[Literal["check"]]
    target: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="TARGET")]
    num_worlds: int = setting(16, AT_LEAST_1)
    cluster: str = "auto"
    seconds: float = setting(5.0, ABOVE_0)
    json: bool = False


COMMAND = ClusterCommand


def run(command: ClusterCommand) -> int:
    """Check and print; return 0, or 1 if a run could not play on one of the machines."""
    from ludus.extras import require_package

    require_package("ray")
    from ludus.workers.node_check import NodeCheckConfig, check_nodes

    names = NodeCheckConfig.__dataclass_fields__
    reports = check_nodes(NodeCheckConfig(**{name: getattr(command, name) for name in names}))
    if command.json:
        sys.stdout.write(json.dumps([asdict(report) for report in reports]) + "\n")
    else:
        _print(reports)
    return int(not reports or any(report.error for report in reports))


def _print(reports: Sequence[NodeReport]) -> None:
    from rich.console import Console

    console = Console()
    console.print(_table(reports))
    for report in reports:
        if report.error:
            console.print(f"error: {report.error}", markup=False, highlight=False, soft_wrap=True)
            if report.hint:
                console.print(f"hint: {report.hint}", markup=False, highlight=False, soft_wrap=True)


def _table(reports: Sequence[NodeReport]) -> Table:
    from rich.table import Table
    from rich.text import Text

    table = Table(title=f"{len(reports)} machines", title_justify="left")
    for heading in ("node", "CPUs", "Ludus", "Python", "engines", "MB/s", "agent-steps/s", ""):
        table.add_column(heading, overflow="fold")
    for report in reports:
        cells = [
            report.node,
            f"{report.cpus:g}",
            str(report.facts.get("ludus", "-")),
            str(report.facts.get("python", "-")),
            "\n".join(report.facts.get("engines", [])) or "-",
            _figure(report.megabytes_per_s),
            _figure(report.agent_steps_per_s),
            "FAIL" if report.error else "ok",
        ]
        table.add_row(*map(Text, cells))
    return table


def _figure(value: float | None) -> str:
    return "-" if value is None else f"{value:,.0f}"
