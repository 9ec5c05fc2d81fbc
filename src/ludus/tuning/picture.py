"""Draw ``sweep.png``: scores by trial, and by each setting that was varied."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ludus.disk import disk_errors
from ludus.tuning.space import Choice, Domain

if TYPE_CHECKING:
    from ludus.tuning.sweeping import Sweep, Trial

__all__ = ["draw_sweep"]

BLUE, ORANGE, PALE = "#2563eb", "#ea580c", "#9ca3af"
MOST_IN_A_ROW = 4
LABELS = {"return": "mean return", "steps": "agent steps"}


def draw_sweep(picture: Path, sweep: Sweep, space: Mapping[str, Domain]) -> None:
    """Draw the trials that were complete as dots, the best in another colour, pruned ones pale.

    Args:
        picture: Where the PNG goes.
        sweep: At least one trial is complete.
        space: What was varied.
    """
    import matplotlib as mpl

    mpl.use("Agg", force=False)
    from matplotlib.figure import Figure
    from matplotlib.ticker import LogLocator, NullFormatter

    trials = [trial for trial in sweep.trials if trial.score is not None]
    width = min(1 + len(space), MOST_IN_A_ROW)
    height = -(-(1 + len(space)) // width)
    figure: Any = Figure(figsize=(4 * width, 3.4 * height), dpi=110, layout="constrained")
    axes = figure.subplots(height, width, sharey=True, squeeze=False).flatten()
    for unused in axes[1 + len(space) :]:
        unused.remove()
    _scatter(axes[0], [trial.number for trial in trials], trials, sweep)
    axes[0].plot(*_best_so_far(trials, sweep), color=ORANGE, linewidth=1.5, drawstyle="steps-post")
    axes[0].set_xlabel("trial")
    for axis in axes[::width]:
        axis.set_ylabel(LABELS[sweep.objective])
    for axis, (name, domain) in zip(axes[1:], space.items(), strict=False):
        shown = [trial for trial in trials if domain.holds(trial.values.get(name))]
        places = [trial.values.get(name) for trial in shown]
        if isinstance(domain, Choice):
            texts = list(domain.texts)
            places = [texts.index(json.dumps(place)) for place in places]
            axis.set_xticks(range(len(texts)), [text.strip('"') for text in texts])
        elif domain.is_log:
            axis.set_xscale("log")
            axis.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            axis.xaxis.set_major_formatter("{x:g}")
            axis.xaxis.set_minor_formatter(NullFormatter())
        _scatter(axis, places, shown, sweep)
        axis.set_xlabel(name)
    with disk_errors(str(picture)):
        figure.savefig(picture)


def _scatter(axis: Any, places: Sequence[Any], trials: Sequence[Trial], sweep: Sweep) -> None:
    best = sweep.best
    colours = [
        ORANGE if best is not None and trial.number == best.number
        else BLUE if trial.state == "complete" else PALE
        for trial in trials
    ]  # fmt: skip
    axis.scatter(places, [trial.score for trial in trials], c=colours, s=22)
    axis.grid(color="#e5e7eb", linewidth=0.8)
    axis.set_axisbelow(True)
    axis.spines[["top", "right"]].set_visible(False)


def _best_so_far(trials: Sequence[Trial], sweep: Sweep) -> tuple[list[int], list[float]]:
    numbers: list[int] = []
    scores: list[float] = []
    better = min if sweep.objective == "steps" else max
    for trial in trials:
        if trial.state == "complete" and trial.score is not None:
            numbers.append(trial.number)
            scores.append(better([*scores[-1:], trial.score]))
    return numbers, scores
