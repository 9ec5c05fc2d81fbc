"""What one Ray worker costs beside none."""

from __future__ import annotations

import statistics
from dataclasses import dataclass
from typing import Any

from cluster_timing import agent_steps_per_s, print_table, ray_cluster


@dataclass(frozen=True)
class Overhead:
    """Train with one Ray worker and without a cluster, in turns.

    Attributes:
        rounds: Pairs of runs; the median of their ratios counts.
        seconds: Of each run.
        targets: Games, each with its number of worlds.
        engines: Of the one machine.
    """

    rounds: int = 5
    seconds: float = 6.0
    targets: tuple[str, ...] = ("cartpole:64", "ball_chase:4", "find_coin:50")
    engines: int = 1


def measure_overhead(options: Overhead) -> None:
    """Print how fast one Ray worker is beside the local trainer."""
    rows: list[list[object]] = []
    with ray_cluster(1):
        for target in options.targets:
            for overlap in (False, True):
                game, _, worlds = target.partition(":")
                settings: dict[str, Any] = {
                    "num_worlds": int(worlds), "num_engines": options.engines,
                    "ppo": {"overlap": overlap},
                }  # fmt: skip

                def run(target: str = game, of: Any = settings, **cluster: Any) -> float:
                    return agent_steps_per_s(options.seconds, target, **of, **cluster)

                pairs = [
                    (run(cluster="auto", num_machines=1), run()) for _ in range(options.rounds)
                ]
                ratios = sorted(one / other for one, other in pairs)
                spread, alone = (statistics.median(each) for each in zip(*pairs, strict=True))
                rows.append([game, worlds, "overlap" if overlap else "", f"{spread:,.0f}",
                             f"{alone:,.0f}", f"{statistics.median(ratios):.3f}",
                             f"{ratios[0]:.3f} to {ratios[-1]:.3f}"])  # fmt: skip
                print(*rows[-1], flush=True)
    print_table(["game", "worlds", "", "one Ray worker", "no cluster", "ratio", "of pairs"], rows)
