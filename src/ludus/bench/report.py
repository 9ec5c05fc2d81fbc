"""The figures of one benchmark."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

__all__ = ["BenchReport", "Breakdown"]


@dataclass(frozen=True)
class Breakdown:
    """Where the time of one step of one engine goes, microseconds.

    Attributes:
        engine_us: Physics and the game's own scripts.
        bridge_us: The add-on: its loops over agents and the game's methods that they call
            (``apply_action``, ``get_observation``, ``get_reward``, ``is_done``, ``reset``).
        transport_us: Sockets and wake-ups; with several engines also the wait for a turn.
        python_us: Python outside of waiting.
    """

    engine_us: float
    bridge_us: float
    transport_us: float
    python_us: float


@dataclass(frozen=True, kw_only=True)
class BenchReport:
    """Medians over the rounds of one benchmark.

    Attributes:
        target: What was measured.
        engine: Name and version.
        layout: ``"isolated"`` or ``"grid"``.
        num_worlds: Worlds per engine.
        num_engines: Engines.
        num_agents: Agents in all.
        ticks_per_step: Physics ticks per decision.
        agent_steps_per_s: Decisions of all agents per second through the socket.
        ceiling_agent_steps_per_s: The same with random actions drawn inside the engine, without
            encoding and without socket: all that the game itself does.
        efficiency: Ratio of the two, the median of the rounds' ratios.
        round_trip_us: One world, one step, without the time its ticks take, microseconds.
        socket_echo_us: A bare blocking echo of messages of the same sizes between Python and the
            engine over the same kind of socket; None where it cannot be measured.
        breakdown: Where a step's time goes.
        memory_per_world_bytes: Resident memory per world beyond the first.
        rounds: ``agent_steps_per_s`` and ``ceiling_agent_steps_per_s`` of each round.
    """

    target: str
    engine: str
    layout: str
    num_worlds: int
    num_engines: int
    num_agents: int
    ticks_per_step: int
    agent_steps_per_s: float
    ceiling_agent_steps_per_s: float
    efficiency: float
    round_trip_us: float
    socket_echo_us: float | None
    breakdown: Breakdown
    memory_per_world_bytes: float | None
    rounds: tuple[tuple[float, float], ...]

    def to_json(self) -> dict[str, Any]:
        """Return the report as JSON types."""
        return asdict(self)
