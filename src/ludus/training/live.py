"""Show a run while it goes on: a live view on terminals and in notebooks, else plain lines."""

from __future__ import annotations

import io
import statistics
import sys
import time
from collections import deque
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from ludus.play.evaluation import Evaluation
from ludus.runs.run_list import StopReason
from ludus.settings.policy_config import Mode
from ludus.settings.train_config import TrainConfig
from ludus.training.figures import CURVE_WIDTH, clock, sparkline
from ludus.training.progress import Progress, RunResult, SilentReporter

if TYPE_CHECKING:
    from ludus.algorithms.imitation import Cloning
    from ludus.workers.interface import MachineState

__all__ = ["TerminalReporter", "evaluation_table", "reporter_for", "reporter_for_script"]

REFRESH_S, LINE_EVERY_S = 0.25, 2.0
SLOW = 1.5
"""A machine that takes this many times as long as most is named."""
NOTEBOOK_WIDTH = 100
"""Characters."""
ENDINGS: dict[StopReason, str] = {
    "total_steps": "ended at total_steps",
    "max_time": "ended at max_time_s",
    "target_return": "ended at target_return",
    "stopped": "stopped on request",
    "interrupted": "interrupted",
}


class TerminalReporter:
    """A :class:`~ludus.training.progress.Reporter` that writes to a terminal or a plain stream."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._live: Live | None = None
        self._every_s = REFRESH_S if console.is_terminal else LINE_EVERY_S
        self._shown_at_s = 0.0
        self._curves: dict[str, Curve] = {}
        self._max_time_s: float | None = None
        self._has_started = False

    def cloning(self, cloning: Cloning) -> None:
        """Show how far it is, a few times per second at most, and what came of it."""
        self._start_view()
        line = Text(cloning_line(cloning))
        is_over = cloning.epoch == cloning.epochs
        if is_over:
            self.stop()
        if is_over or self._is_due():
            self._show(line, line)

    def started(self, config: TrainConfig, run: Path) -> None:
        """Say what is trained, and where it goes."""
        self._max_time_s = config.max_time_s
        self._has_started = True
        line = Text.assemble("training ", (config.target, "bold"), f" into {run}")
        self._console.print(line, highlight=False)
        self._start_view()

    def updated(self, progress: Progress) -> None:
        """Show progress, a few times per second at most."""
        self._note_returns(progress)
        if self._is_due():
            self._start_view()
            line = progress_line(progress, self._share(progress))
            self._show(self._picture(progress), Text(line))

    def evaluating(self, episodes: int) -> None:
        """Say that the evaluation begins."""
        self.stop()
        self._console.print(f"evaluating over {episodes} episodes", highlight=False)

    def finished(self, result: RunResult) -> None:
        """Show how the run ended; nothing if it had ended before it was resumed."""
        self.stop()
        if not self._has_started:
            return
        if result.signum is None:
            self._console.print(summary_table(result))
        self._console.print(Text(f"run folder: {result.path}"), highlight=False, soft_wrap=True)

    def stop(self) -> None:
        """End the live view."""
        if self._live:
            self._live.stop()
            self._live = None

    def _start_view(self) -> None:
        if self._console.is_terminal and self._live is None:
            self._live = Live(console=self._console, auto_refresh=False, transient=True)
            self._live.start()

    def _is_due(self) -> bool:
        """Return whether to show something again, and note that."""
        now = time.monotonic()
        if now - self._shown_at_s < self._every_s:
            return False
        self._shown_at_s = now
        return True

    def _show(self, picture: RenderableType, line: Text) -> None:
        """Show a picture in the live view, or write a line where there is none."""
        if self._live:
            self._live.update(picture, refresh=True)
        else:
            self._console.print(line, highlight=False, soft_wrap=True)

    def _note_returns(self, progress: Progress) -> None:
        for name, metrics in progress.policies.items():
            if "mean_return" in metrics:
                self._curves.setdefault(name, Curve()).add(metrics["mean_return"])

    def _picture(self, progress: Progress) -> Group:
        share = self._share(progress)
        table = Table.grid(padding=(0, 2))
        table.add_row(ProgressBar(1.0, share, width=CURVE_WIDTH), progress_head(progress, share))
        if progress.machines:
            table.add_row("", Text(machines_text(progress.machines)))
        for name, metrics in progress.policies.items():
            curve = self._curves.get(name, Curve())
            text = policy_text(name, metrics, progress.modes.get(name, "train"))
            table.add_row(Text(sparkline(curve.points), style="cyan"), text)
        return Group(table)

    def _share(self, progress: Progress) -> float:
        """Return how much of the run is done, by the limit that it is nearer to."""
        by_steps = progress.agent_steps / progress.total_steps
        by_time = progress.wall_s / self._max_time_s if self._max_time_s else 0.0
        return min(1.0, max(by_steps, by_time))


class NotebookReporter(TerminalReporter):
    """Shows a run in one output of a notebook cell, which is drawn again and again."""

    def __init__(self) -> None:
        # Rich's own view needs ipywidgets; a plain text that is replaced needs nothing.
        # In a notebook, Rich would add an empty output of its own to each print.
        console = Console(file=io.StringIO(), width=NOTEBOOK_WIDTH, force_jupyter=False)
        super().__init__(console)
        self._every_s = REFRESH_S
        self._started = ""
        self._display: Any = None

    def started(self, config: TrainConfig, run: Path) -> None:
        """Say what is trained, and where it goes."""
        self._max_time_s = config.max_time_s
        self._has_started = True
        self._started = f"training {config.target} into {run}\n"
        self._show(Text(end=""))

    def evaluating(self, episodes: int) -> None:
        """Say that the evaluation begins."""
        self._show(Text(f"evaluating over {episodes} episodes"))

    def finished(self, result: RunResult) -> None:
        """Show how the run ended; nothing if it had ended before it was resumed."""
        if self._has_started:
            self._show(summary_table(result))

    def _start_view(self) -> None:
        """Start none: Rich's would take what the cell prints, where ipykernel says FORCE_COLOR."""

    def _show(self, picture: RenderableType, line: Text | None = None) -> None:
        with self._console.capture() as text:
            self._console.print(picture)
        shown = {"text/plain": self._started + text.get()}
        if self._display is None:
            import IPython.display

            module: Any = IPython.display
            self._display = module.display(shown, raw=True, display_id=True)
        else:
            self._display.update(shown, raw=True)


class Curve:
    """The whole history of a number in at most ``2 * CURVE_WIDTH`` points."""

    def __init__(self) -> None:
        self.points: list[float] = []
        self._stride = 1
        self._pending: deque[float] = deque()

    def add(self, value: float) -> None:
        """Add a value; neighbours are averaged as the history grows."""
        self._pending.append(value)
        if len(self._pending) < self._stride:
            return
        self.points.append(sum(self._pending) / len(self._pending))
        self._pending.clear()
        if len(self.points) >= 2 * CURVE_WIDTH:
            pairs = zip(self.points[::2], self.points[1::2], strict=True)
            self.points = [(first + second) / 2 for first, second in pairs]
            self._stride *= 2


def cloning_line(cloning: Cloning) -> str:
    """Return how far the cloning of demonstrations is, or what came of it."""
    shown = cloning.demonstrations
    if cloning.epoch < cloning.epochs:
        text = f"cloning {shown.name}: pass {cloning.epoch} of {cloning.epochs}"
    else:
        num_episodes = len(shown.lengths)
        text = f"cloned {num_episodes} episodes, {shown.num_steps:,} steps, of {shown.name}"
    return f"{text}  {clock(cloning.wall_s)}  {cloning.policy}: loss {cloning.loss:.3f}"


def progress_head(progress: Progress, share: float) -> str:
    """Return share done, steps, speed and time of the whole run."""
    text = (
        f"{share:4.0%}  {progress.agent_steps:,} steps  {progress.steps_per_s:,.0f} steps/s  "
        f"{clock(progress.wall_s)} elapsed, up to {clock(progress.time_left_s)} left"
    )
    return text + (f"  {progress.restarts} restarts" if progress.restarts else "")


def policy_text(name: str, metrics: Mapping[str, float], mode: Mode) -> str:
    """Return the figures of one policy, and its mode unless that is ``train``."""
    heading = name if mode == "train" else f"{name} ({mode})"
    if "mean_return" not in metrics:
        return f"{heading}: no episode has ended yet"
    text = (
        f"{heading}: mean return {metrics['mean_return']:.4g} "
        f"(lowest {metrics['min_return']:.4g}, highest {metrics['max_return']:.4g})"
    )
    return text + (f", elo {metrics['elo']:.0f}" if "elo" in metrics else "")


def progress_line(progress: Progress, share: float) -> str:
    """Return everything in one line, for streams other than terminals."""
    policies = (
        policy_text(name, metrics, progress.modes.get(name, "train"))
        for name, metrics in progress.policies.items()
    )
    machines = [machines_text(progress.machines)] if progress.machines else []
    return "  ".join([progress_head(progress, share), *machines, *policies])


def machines_text(machines: Sequence[MachineState]) -> str:
    """Return how many machines play, which is slow, and which are lost."""
    playing = [machine for machine in machines if not machine.is_lost]
    engines = sum(machine.num_engines for machine in playing)
    text = f"{len(playing)} of {len(machines)} machines play, {engines} engines"
    usual_s = statistics.median_low([machine.play_s for machine in playing] or [0.0])
    slowest = max(playing, key=lambda machine: machine.play_s, default=None)
    if slowest is not None and slowest.play_s > SLOW * usual_s:
        text += f"; slow: {slowest.name}, {slowest.play_s / max(usual_s, 1e-9):.1f} × the others"
    lost = [machine.name for machine in machines if machine.is_lost]
    return text + (f"; lost: {', '.join(lost)}" if lost else "")


def summary_table(result: RunResult) -> Table:
    """Return a table of the evaluation, or of the last episodes if there was none."""
    steps = f"{result.agent_steps:,} agent steps in {clock(result.wall_s)}"
    table = evaluation_table(result.evaluation, f"{steps} ({ENDINGS[result.stop_reason]})")
    if not result.evaluation:
        for name, mean in result.mean_return.items():
            table.add_row(Text(name), "training", f"{mean:.4g}", "", "", "", "")
    return table


def evaluation_table(
    evaluation: Mapping[str, Evaluation], title: str, goal_return: float | None = None
) -> Table:
    """Return a table with a row per policy; with the share that reached ``goal_return``, if any."""
    table = Table(title=Text(title), title_justify="left")
    for heading in ("policy", "episodes", "mean return", "± std", "min", "max", "length"):
        table.add_column(heading, justify="left" if heading == "policy" else "right")
    if goal_return is not None:
        table.add_column(f"≥ {goal_return:g}", justify="right")
    for name, of in evaluation.items():
        figures = (of.mean_return, of.std_return, of.min_return, of.max_return, of.mean_length)
        cells = [str(of.num_episodes), *(f"{figure:.4g}" for figure in figures)]
        if goal_return is not None:
            cells.append(f"{of.share_reaching(goal_return):.1%}")
        table.add_row(Text(name), *cells)  # no markup: a name may have brackets
    return table


@contextmanager
def reporter_for(stream: TextIO) -> Generator[TerminalReporter, None, None]:
    """Give a reporter on ``stream``; its live view ends with the context, whatever happens."""
    reporter = TerminalReporter(Console(file=stream))  # rich honours NO_COLOR
    try:
        yield reporter
    finally:
        reporter.stop()


@contextmanager
def reporter_for_script(
    progress: bool | None,
) -> Generator[TerminalReporter | SilentReporter, None, None]:
    """Give the reporter of a script.

    Args:
        progress: Whether to show something; None shows it in notebooks and on terminals.
    """
    in_notebook = _is_notebook()
    if not (in_notebook or sys.stderr.isatty() if progress is None else progress):
        yield SilentReporter()
    elif in_notebook:
        yield NotebookReporter()
    else:
        with reporter_for(sys.stderr) as reporter:
            yield reporter


def _is_notebook() -> bool:
    """Return whether a kernel with a front end runs this process."""
    ipython: Any = sys.modules.get("IPython")
    shell = None if ipython is None else ipython.get_ipython()
    return shell is not None and hasattr(shell, "kernel")
