"""``ludus bench``: how fast does a game step, how fast could it, and where does the time go?"""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from typing import Annotated

import tyro

from ludus.bench import BenchConfig, BenchReport, bench
from ludus.cli.bridge_flags import BridgeFlags
from ludus.settings.checks import AT_LEAST_1, setting

__all__ = ["COMMAND", "BenchCommand", "run"]


@dataclass(frozen=True, kw_only=True)
class BenchCommand(BridgeFlags, BenchConfig):
    """Measure how fast a game steps with random actions, and where the time goes.

    Bridged play and the ceiling (random actions drawn inside the engine, no socket) alternate;
    the figures are medians over the rounds.

    Attributes:
        json: Print one JSON object on stdout.
    """

    target: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="TARGET")]
    num_worlds: Annotated[int, tyro.conf.arg(aliases=["--worlds"])] = setting(64, AT_LEAST_1)
    num_engines: Annotated[int, tyro.conf.arg(aliases=["--engines"])] = setting(1, AT_LEAST_1)
    json: bool = False


COMMAND = BenchCommand
RENAMED_FLAGS = {"--pinned": "--is-pinned", "--no-pinned": "--no-is-pinned"}


def run(command: BenchCommand) -> int:
    """Measure and print; return 0."""
    report = bench(command, lambda stage: _tell(f"{stage} ..."))
    text = json.dumps(report.to_json()) if command.json else _table(report)
    sys.stdout.write(text + "\n")
    return 0


def _tell(stage: str) -> None:
    sys.stderr.write(stage + "\n")


def _table(report: BenchReport) -> str:
    echo = report.socket_echo_us
    memory = report.memory_per_world_bytes
    parts = report.breakdown
    rows = [
        ("target", f"{report.target}, {report.engine}"),
        (
            "size",
            f"{report.num_engines} engines × {report.num_worlds} worlds ({report.layout}), "
            f"{report.num_agents} agents, {report.ticks_per_step} ticks a step",
        ),
        ("agent-steps/s", f"{report.agent_steps_per_s:,.0f}"),
        ("ceiling", f"{report.ceiling_agent_steps_per_s:,.0f}"),
        ("efficiency", f"{report.efficiency:.2f}"),
        (
            "step of one engine",
            f"engine {parts.engine_us:.0f} µs, bridge {parts.bridge_us:.0f} µs, "
            f"transport {parts.transport_us:.0f} µs, Python {parts.python_us:.0f} µs",
        ),
        ("round trip, one world", f"{report.round_trip_us:.1f} µs"),
        ("bare socket echo", "-" if echo is None else f"{echo:.1f} µs"),
        ("memory per world", "-" if memory is None else f"{memory / 1024:.1f} KiB"),
    ]
    width = max(len(name) for name, _ in rows)
    return "\n".join(f"{name:<{width}}  {value}" for name, value in rows)
