"""How much one learner takes in, from workers that replay what they recorded once."""

from __future__ import annotations

import pickle
import statistics
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cluster_games import WIDTHS
from cluster_timing import agent_steps_per_s, print_table

from ludus.settings.train_config import TrainConfig
from ludus.workers import opening
from ludus.workers.worker import Worker


@dataclass(frozen=True)
class Learner:
    """Let workers replay what they recorded once: what is left is the learner's own time.

    Attributes:
        rounds: Runs of each size; medians count.
        seconds: Of each run.
        workers: How many replay.
        worlds: Of each worker.
        cartpole: Agent-steps/s that one core plays on the machine of the learner, by
            ``ludus bench cartpole --worlds 64 --engines 1``; the default is that of the docs.
        pixels: The same for pictures of 84 × 84 in 3D, by ``benchmarks/cameras.py``.
    """

    rounds: int = 3
    seconds: float = 6.0
    workers: int = 4
    worlds: int = 64
    cartpole: float = 134_204
    pixels: float = 5_314


class Replaying:
    """A :class:`~ludus.workers.interface.Machine` that plays once, and hands that out for ever.

    What it hands out is pickled once and unpickled each time, as if it came through a pipe.
    """

    report_bytes = 0

    def __init__(self, config: TrainConfig, index: int, log_dir: Path | None) -> None:
        self.name = f"machine {index}"
        self._worker = Worker(config, index, log_dir)
        self._report: bytes | None = None
        self._answer = pickle.dumps(self._worker.spec, protocol=5)

    def send(self, method: str, *arguments: Any) -> None:
        """Answer with the first full report if there is one."""
        is_play = method == "play" and arguments[0].num_steps
        if is_play and self._report is not None:
            self._answer = self._report
            return
        self._answer = pickle.dumps(getattr(self._worker, method)(*arguments), protocol=5)
        if is_play:
            self._report = self._answer
            type(self).report_bytes = len(self._answer)

    def receive(self) -> Any:
        """Unpickle the answer."""
        return pickle.loads(self._answer)

    def close(self) -> None:
        """End the worker."""
        self._worker.close()


NETWORKS: dict[str, dict[str, Any]] = {
    "64, 64": {"hidden_sizes": (64, 64)},
    "256, 256": {"hidden_sizes": (256, 256)},
}


@dataclass(frozen=True)
class Game:
    """A game to reckon with.

    Attributes:
        name: For people.
        core_per_s: Agent-steps/s that one core plays.
        observation: Which of the measured observations is closest.
        network: Which of the measured networks.
    """

    name: str
    core_per_s: float
    observation: str
    network: str


MANY_CORES = 8000
"""Of 1,000 machines."""


def measure_learner(options: Learner) -> None:
    """Print how many agent-steps/s one learner takes in, by observation and network."""
    opening.ProcessMachine = Replaying  # pyright: ignore[reportAttributeAccessIssue]
    rows: list[list[object]] = []
    measured: dict[tuple[str, str], tuple[float, float]] = {}
    for game in (*(f"Wide-{width}" for width in WIDTHS), "Pixels"):
        for network, ppo in NETWORKS.items():
            # Pictures are large, and go through a convolution: fewer worlds, or no update ends.
            worlds = options.worlds if game != "Pixels" else max(1, options.worlds // 8)
            speeds = [
                agent_steps_per_s(
                    options.seconds, f"gym:cluster_games:{game}-v0", num_worlds=worlds,
                    num_engines=1, cluster=f"local:{options.workers}", ppo=ppo,
                )
                for _ in range(options.rounds)
            ]  # fmt: skip
            speed = statistics.median(speeds)
            step_bytes = Replaying.report_bytes / (worlds * 32)
            measured[game, network] = speed, step_bytes
            rows.append([game, network, f"{speed:,.0f}", f"{step_bytes:,.0f}",
                         f"{speed * step_bytes / 1e6:,.1f}",
                         f"{min(speeds):,.0f} to {max(speeds):,.0f}"])  # fmt: skip
            print(*rows[-1], flush=True)
    print_table(
        ["observation", "units", "agent-steps/s", "bytes a step", "MB/s", "of rounds"], rows
    )
    print_reckoning(options, measured)


def print_reckoning(options: Learner, measured: dict[tuple[str, str], tuple[float, float]]) -> None:
    """Print how far games scale with such a learner, from its speed and the bytes of a step."""
    games = (
        Game("cartpole, 64 worlds", options.cartpole, "Wide-4", "64, 64"),
        Game("100 agents that see 64 numbers, 5 ms a step", 100 / 0.005, "Wide-64", "256, 256"),
        Game("84 × 84 pixels, 3D, drawn by software", options.pixels, "Pixels", "64, 64"),
    )
    rows: list[list[object]] = []
    for game in games:
        speed, step_bytes = measured[game.observation, game.network]
        cores = speed / game.core_per_s
        many_per_s = game.core_per_s * MANY_CORES
        rows.append([game.name, f"{game.core_per_s:,.0f}", f"{speed:,.0f}", f"{cores:,.1f}",
                     f"{speed * step_bytes / 1e6:,.1f}", f"{many_per_s / speed:,.0f}",
                     f"{many_per_s * step_bytes / 1e9:,.1f}"])  # fmt: skip
    print_table(
        ["game", "a core plays, agent-steps/s", "a learner takes in", "cores that keep it busy",
         "MB/s then", f"learners for {MANY_CORES:,} cores", "GB/s then"],
        rows,
    )  # fmt: skip
