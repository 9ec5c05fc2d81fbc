"""Figures as text: durations, and curves of small bars; needs no extra."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

__all__ = ["CURVE_WIDTH", "clock", "sparkline"]

BARS = "▁▂▃▄▅▆▇█"
CURVE_WIDTH = 24


def sparkline(values: Sequence[float], width: int = CURVE_WIDTH) -> str:
    """Return ``values`` as a line of at most ``width`` small bars."""
    if not values:
        return ""
    if len(values) > width:
        bounds = [len(values) * index // width for index in range(width + 1)]
        parts = [values[start:stop] for start, stop in itertools.pairwise(bounds)]
        values = [sum(part) / len(part) for part in parts]
    low, high = min(values), max(values)
    scale = (len(BARS) - 1) / (high - low) if high > low else 0.0
    return "".join(BARS[round((value - low) * scale)] for value in values)


def clock(seconds: float) -> str:
    """Return a duration in the largest fitting units: ``4.2 s``, ``3:07 min``, ``1:02:03 h``."""
    if seconds < 60:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02} h" if hours else f"{minutes}:{rest:02} min"
