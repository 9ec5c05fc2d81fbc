"""Draw ``learning_curve.png``."""

from __future__ import annotations

import io
import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ludus.disk import disk_errors, write_atomically
from ludus.runs.metrics import read_metrics

__all__ = ["draw_learning_curve"]

COLOURS = ("#2563eb", "#ea580c", "#059669", "#9333ea", "#dc2626", "#0891b2")
INK, PALE = "#1f2937", "#6b7280"
BAND = ("return_p10", "return_p90")
MAX_POINTS = 240
"""Of a curve: more would be a thick band of noise."""
LABEL_HEIGHT = 0.055
"""Of a line of text, as a share of the picture's height."""

_Points = NDArray[np.float64]
"""Rows: agent steps, mean, low, high; a column for every update."""


def draw_learning_curve(metrics: Path, picture: Path, title: str) -> bool:
    """Draw mean return over agent steps, a band from the 10th to the 90th percentile, and time.

    Args:
        metrics: A ``metrics.jsonl``.
        picture: Where the PNG goes.
        title: Heading.

    Returns:
        Whether there was anything to draw: at least one episode ended.
    """
    lines = read_metrics(metrics) if metrics.exists() else []
    names = list(dict.fromkeys(name for line in lines for name in line["policies"]))
    curves = {name: points for name in names if (points := _curve(lines, name)) is not None}
    if not curves:
        return False

    import matplotlib as mpl

    mpl.use("Agg", force=False)
    from matplotlib.figure import Figure

    figure: Any = Figure(figsize=(8, 4.5), dpi=150, layout="constrained")
    axes = figure.subplots()
    colours = dict(zip(curves, itertools.cycle(COLOURS), strict=False))
    for name, points in curves.items():
        _draw_policy(axes, colours[name], points)
    _label_ends(axes, curves, colours)
    _decorate(axes, title)
    _add_clock(axes, lines)
    image = io.BytesIO()
    figure.savefig(image, format="png")
    with disk_errors(str(picture)):
        write_atomically(picture, image.getvalue())
    return True


def _curve(lines: Sequence[dict[str, Any]], policy: str) -> _Points | None:
    """Return the updates that had episodes, neighbours averaged where there are many."""
    values = [(line["agent_steps"], line["policies"].get(policy, {})) for line in lines]
    rows = [
        (steps, of.get("mean_return"), of.get(BAND[0]), of.get(BAND[1])) for steps, of in values
    ]
    points = [row for row in rows if all(isinstance(value, int | float) for value in row)]
    return subsample(np.asarray(points, np.float64).T) if points else None


def subsample(points: _Points, max_points: int = MAX_POINTS) -> _Points:
    """Average neighbouring columns until at most ``max_points`` are left, from first to last step.

    Args:
        points: Rows of numbers, the first one growing.
        max_points: At least 1.
    """
    if points.shape[1] <= max_points:
        return points
    groups = np.array_split(points, max_points, axis=1)
    sampled = np.stack([group.mean(axis=1) for group in groups], axis=1)
    sampled[0, [0, -1]] = points[0, [0, -1]]
    return sampled


def space_apart(values: Sequence[float], gap: float) -> list[float]:
    """Move values apart, so that none is nearer to another than ``gap``; their order stays."""
    order = np.argsort(values, kind="stable")
    placed = np.asarray(values, np.float64)
    above = placed[order] - gap * np.arange(len(order))
    # These must not fall: take the middle between what pushes them up and what pushes them down.
    from_below = np.maximum.accumulate(above)
    from_above = np.minimum.accumulate(above[::-1])[::-1]
    placed[order] = (from_below + from_above) / 2.0 + gap * np.arange(len(order))
    return placed.tolist()


def _draw_policy(axes: Any, colour: str, points: _Points) -> None:
    steps, mean, low, high = points
    axes.fill_between(steps, low, high, color=colour, alpha=0.16, linewidth=0)
    axes.plot(steps, mean, color=colour, linewidth=2, solid_capstyle="round")
    axes.plot(steps[-1], mean[-1], "o", color=colour, markersize=5)


def _label_ends(axes: Any, curves: dict[str, _Points], colours: dict[str, str]) -> None:
    """Write the last means beside the curves, and whose they are if there are several."""
    low, high = axes.get_ylim()
    heights = space_apart(
        [points[1, -1] for points in curves.values()], LABEL_HEIGHT * (high - low)
    )
    for (name, points), height in zip(curves.items(), heights, strict=True):
        value = f"{points[1, -1]:.4g}"
        axes.annotate(
            f"{name} {value}" if len(curves) > 1 else value, (points[0, -1], height),
            xytext=(7, 0), textcoords="offset points", color=colours[name], fontweight="bold",
            va="center", annotation_clip=False, parse_math=False,
        )  # fmt: skip


def _decorate(axes: Any, title: str) -> None:
    axes.set_title(title, loc="left", color=INK, fontweight="bold", pad=28, parse_math=False)
    axes.set_xlabel("agent steps", color=PALE)
    axes.set_ylabel("return: mean, 10th to 90th percentile", color=PALE)
    axes.grid(axis="y", color="#e5e7eb", linewidth=0.8)
    axes.set_axisbelow(True)
    axes.tick_params(colors=PALE, length=0)
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.spines["bottom"].set_color("#d1d5db")
    axes.set_xlim(left=0)
    axes.xaxis.set_major_formatter(_short_number)


def _add_clock(axes: Any, lines: Sequence[dict[str, Any]]) -> None:
    """Put the seconds of training on an axis above."""
    steps = np.asarray([0.0, *(line["agent_steps"] for line in lines)])
    seconds = np.asarray([0.0, *(line.get("wall_s", 0.0) for line in lines)])
    if seconds[-1] <= 0 or not (np.diff(steps) > 0).all() or not (np.diff(seconds) > 0).all():
        return
    clock = axes.twiny()
    clock.set_xlim(axes.get_xlim())
    ticks = [tick for tick in _round_seconds(seconds[-1]) if tick <= seconds[-1]]
    clock.set_xticks(np.interp(ticks, seconds, steps), [_clock(tick) for tick in ticks])
    clock.tick_params(colors=PALE, length=0, labelsize=8)
    clock.spines[:].set_visible(False)


def _round_seconds(last: float) -> list[float]:
    steps = (0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 1800, 3600, 7200, 18000, 43200)
    step = next((step for step in steps if last / step <= 7), 86400.0)
    return [step * index for index in range(int(last / step) + 1)]


def _clock(seconds: float) -> str:
    if seconds < 120:
        return f"{seconds:g} s"
    return f"{seconds / 60:g} min" if seconds < 7200 else f"{seconds / 3600:g} h"


def _short_number(value: float, _: int | None = None) -> str:
    for size, letter in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if value >= size:
            return f"{value / size:g}{letter}"
    return f"{value:g}"
