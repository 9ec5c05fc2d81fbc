"""``ludus bench``: how fast does a game step, how fast could it, and where does the time go?"""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

if TYPE_CHECKING:
    from ludus.bench import BenchReport

__all__ = ["COMMAND", "BenchCommand", "run"]


@dataclass(frozen=True)
class BenchCommand:
    """Measure how fast a game steps with random actions, how fast it could, and where time goes.

    Bridged play and the ceiling (random actions drawn inside the engine, no socket) alternate;
    the figures are medians over the rounds.

    Attributes:
        target: A bundled example, a project folder, a scene, or an exported game.
        scene: Scene of the project, such as res://level.tscn; none is its main scene.
        worlds: Worlds per engine.
        engines: Game processes.
        layout: How worlds are kept apart; scene is what the scene asks for.
        ticks_per_step: Physics ticks per decision; none is what the agents say.
        seconds: Length of each part of a round.
        rounds: How often bridged play and ceiling alternate.
        pinned: Give each engine a core of its own.
        json: Print one JSON object on stdout.
        godot: Engine to use; none is the one that ludus finds.
    """

    target: tyro.conf.Positional[str]
    scene: str | None = None
    worlds: Annotated[int, tyro.conf.arg(aliases=["--num-worlds"])] = 64
    engines: Annotated[int, tyro.conf.arg(aliases=["--num-engines"])] = 1
    layout: Literal["scene", "isolated", "grid"] = "scene"
    ticks_per_step: int | None = None
    seconds: float = 2.0
    rounds: int = 5
    pinned: bool = True
    json: bool = False
    godot: Path | None = None


COMMAND = BenchCommand


def run(command: BenchCommand) -> int:
    """Measure and print; return 0."""
    from ludus.bench import BenchConfig, bench
    from ludus.pool import PoolConfig

    pool = PoolConfig(
        scene=command.scene,
        num_worlds=command.worlds,
        num_engines=command.engines,
        layout=command.layout,
        ticks_per_step=command.ticks_per_step,
        godot=command.godot,
        is_pinned=command.pinned,
    )
    config = BenchConfig(
        target=command.target, pool=pool, seconds=command.seconds, rounds=command.rounds
    )
    report = bench(config, lambda stage: _tell(f"{stage} ..."))
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
