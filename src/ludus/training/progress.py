"""What a run tells while it runs; how that is shown is the command line's business."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from ludus.play.evaluation import Evaluation
from ludus.runs.run_list import StopReason
from ludus.settings.policy_config import Mode
from ludus.settings.train_config import TrainConfig

if TYPE_CHECKING:
    from ludus.algorithms.imitation import Cloning
    from ludus.workers.interface import MachineState

__all__ = ["Progress", "Reporter", "RunResult", "SilentReporter"]


@dataclass(frozen=True)
class Progress:
    """How far a run is.

    Attributes:
        agent_steps: Agent steps so far.
        total_steps: Agent steps at which it ends.
        wall_s: Seconds of training so far.
        time_left_s: Seconds until a limit is reached at the present speed; an upper bound.
        steps_per_s: Agent steps per second, lately.
        policies: Metrics of each policy.
        restarts: Engines restarted so far.
        modes: Mode of each policy.
        machines: How the machines of a cluster do; none without one.
    """

    agent_steps: int
    total_steps: int
    wall_s: float
    time_left_s: float
    steps_per_s: float
    policies: Mapping[str, Mapping[str, float]]
    restarts: int = 0
    modes: Mapping[str, Mode] = field(default_factory=dict[str, Mode])
    machines: Sequence[MachineState] = ()


@dataclass(frozen=True)
class RunResult:
    """How a run ended.

    Attributes:
        path: Its folder.
        stop_reason: Why it ended.
        signum: Signal that interrupted it; None if none did.
        agent_steps: Agent steps in all.
        updates: Updates in all.
        wall_s: Seconds of training, without start and evaluation.
        mean_return: Of the last episodes, per policy.
        evaluation: Per policy; empty if interrupted, or if none was asked for.
    """

    path: Path
    stop_reason: StopReason
    signum: int | None
    agent_steps: int
    updates: int
    wall_s: float
    mean_return: dict[str, float]
    evaluation: dict[str, Evaluation]


class Reporter(Protocol):
    """Is told how a run goes."""

    def cloning(self, cloning: Cloning) -> None:
        """A pass over demonstrations was made, before training begins."""
        ...

    def started(self, config: TrainConfig, run: Path) -> None:
        """Training begins, or goes on."""
        ...

    def updated(self, progress: Progress) -> None:
        """An update was made; several per second are usual."""
        ...

    def evaluating(self, episodes: int) -> None:
        """An evaluation begins: training is over, or ends if this one reaches ``target_return``."""
        ...

    def finished(self, result: RunResult) -> None:
        """The run has ended without an error; not called by the trainer itself."""
        ...


class SilentReporter:
    """Shows nothing."""

    def cloning(self, cloning: Cloning) -> None:
        """Show nothing."""

    def started(self, config: TrainConfig, run: Path) -> None:
        """Show nothing."""

    def updated(self, progress: Progress) -> None:
        """Show nothing."""

    def evaluating(self, episodes: int) -> None:
        """Show nothing."""

    def finished(self, result: RunResult) -> None:
        """Show nothing."""
