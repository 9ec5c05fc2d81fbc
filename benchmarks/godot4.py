"""Measure the bundled Godot 4 examples and print the table of docs/benchmarks.md.

Run on a quiet machine: `python benchmarks/godot4.py [--quick]`.
"""

from __future__ import annotations

from dataclasses import dataclass

import tyro

from ludus.bench import BenchConfig, BenchReport, bench

CASES = [
    ("cartpole", 1, 1),
    ("cartpole", 16, 1),
    ("cartpole", 64, 1),
    ("cartpole", 256, 1),
    ("cartpole", 64, 2),
    ("pendulum", 64, 1),
    ("ball_chase", 1, 1),
    ("ball_chase", 4, 1),
]
"""Target, worlds per engine, engines."""

HEAD = (
    "| example | worlds × engines | agents | agent-steps/s | ceiling | efficiency "
    "| engine / bridge / transport / Python, µs per step | KiB per world |\n"
    "|---|---|---|---|---|---|---|---|"
)


@dataclass(frozen=True)
class Options:
    """What to measure.

    Attributes:
        quick: One short round each, to see that it works.
    """

    quick: bool = False


def main(options: Options) -> None:
    """Measure all cases and print the table."""
    seconds, rounds = (0.5, 1) if options.quick else (2.0, 5)
    print(HEAD)
    for target, num_worlds, num_engines in CASES:
        report = bench(
            BenchConfig(
                target=target,
                num_worlds=num_worlds,
                num_engines=num_engines,
                seconds=seconds,
                rounds=rounds,
            )
        )
        print(row(report), flush=True)
        if num_worlds == 1 and report.socket_echo_us is not None:
            ratio = report.round_trip_us / report.socket_echo_us
            print(
                f"| {target}, round trip {report.round_trip_us:.1f} µs, "
                f"bare echo {report.socket_echo_us:.1f} µs, ratio {ratio:.2f} |||||||",
                flush=True,
            )


def row(report: BenchReport) -> str:
    """Return one line of the table."""
    parts = report.breakdown
    memory = report.memory_per_world_bytes
    return (
        f"| {report.target} | {report.num_worlds} × {report.num_engines} | {report.num_agents} "
        f"| {report.agent_steps_per_s:,.0f} | {report.ceiling_agent_steps_per_s:,.0f} "
        f"| {report.efficiency:.2f} "
        f"| {parts.engine_us:.0f} / {parts.bridge_us:.0f} / {parts.transport_us:.0f} / "
        f"{parts.python_us:.0f} | {'–' if memory is None else f'{memory / 1024:.1f}'} |"
    )


if __name__ == "__main__":
    main(tyro.cli(Options))
