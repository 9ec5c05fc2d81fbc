"""What a game asks of its trainer and reports to it (PROTOCOL.md §8). No input or output."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, cast

from ludus.wire.json_object import JsonObject, read_objects

__all__ = ["CAPABILITY", "MAX_REQUESTS", "METRICS", "MODES", "MetricSummary", "add_metrics",
           "read_requests", "split_metrics"]  # fmt: skip

METRICS = "metrics"
"""The capability of games that report metrics, and the kind of request that holds them."""
MAX_METRICS = 64

CAPABILITY = "requests"
MAX_REQUESTS = 256
MAX_TEXT_LENGTH = 128
MODES = ("train", "frozen", "deterministic")

_WORD = re.compile(rf"[a-z][a-z0-9_]{{0,{MAX_TEXT_LENGTH - 1}}}")


def read_requests(value: Any) -> list[dict[str, Any]]:
    """Check the answer to ``take_requests``.

    Returns:
        The requests, oldest first. Each has a ``kind``, a word. ``set_mode`` has a ``policy``,
        which need not exist, and a ``mode`` of :data:`MODES`. Other kinds are returned unchecked,
        even those that this version does not know.

    Raises:
        ProtocolError: It is not a list of requests, or too long; the text names the place.
    """
    has_metrics = isinstance(value, list) and METRICS in map(_kind_of, cast(list[Any], value)[-1:])
    for reader in read_objects(value, "take_requests()", 0, MAX_REQUESTS + has_metrics):
        kind = reader.text("kind")
        if not _WORD.fullmatch(kind):
            raise reader.unexpected("kind", "a word in lower case", kind)
        if kind == METRICS:
            _read_metrics(reader)
        elif kind == "set_mode":
            reader.name("policy", MAX_TEXT_LENGTH)
            reader.choice("mode", MODES)
    return cast(list[dict[str, Any]], value)


@dataclass(frozen=True)
class MetricSummary:
    """The values of one metric that a game has reported since they were fetched last.

    Attributes:
        count: How many, at least 1.
        sum: Their sum.
        min: The lowest.
        max: The highest.
    """

    count: int
    sum: float
    min: float
    max: float

    def to_json(self) -> dict[str, float]:
        """Return what metrics show: mean, lowest and highest value, and count."""
        mean = self.sum / self.count
        return {"mean": mean, "min": self.min, "max": self.max, "count": self.count}


def split_metrics(
    requests: list[dict[str, Any]],
) -> tuple[list[dict[str, Any]], dict[str, MetricSummary]]:
    """Return requests without metrics, and the metrics by name.

    Args:
        requests: As :func:`read_requests` has checked them.
    """
    others = [request for request in requests if request["kind"] != METRICS]
    metrics: dict[str, MetricSummary] = {}
    for request in requests:
        if request["kind"] == METRICS:
            metrics = add_metrics(metrics, _read_metrics(JsonObject(request, "take_requests()")))
    return others, metrics


def add_metrics(
    first: Mapping[str, MetricSummary], second: Mapping[str, MetricSummary]
) -> dict[str, MetricSummary]:
    """Return the metrics of two sources together."""
    joined = dict(first)
    for name, new in second.items():
        old = joined.get(name)
        if old is not None:
            low, high = min(old.min, new.min), max(old.max, new.max)
            new = MetricSummary(old.count + new.count, old.sum + new.sum, low, high)  # noqa: PLW2901
        joined[name] = new
    return joined


def _kind_of(request: Any) -> Any:
    return cast(dict[str, Any], request).get("kind") if isinstance(request, dict) else None


def _read_metrics(reader: JsonObject) -> dict[str, MetricSummary]:
    """Read the metrics of a request.

    Raises:
        ProtocolError: A name or a number is not allowed, or there are too many.
    """
    metrics = reader.child(METRICS)
    if not 1 <= len(metrics.names()) <= MAX_METRICS:
        raise reader.unexpected(METRICS, f"1 to {MAX_METRICS} names", len(metrics.names()))
    read: dict[str, MetricSummary] = {}
    for name in metrics.names():
        reader.check_name(METRICS, name, MAX_TEXT_LENGTH)
        own = metrics.child(name)
        total, low, high = (own.number(key, own.get(key)) for key in ("sum", "min", "max"))
        read[name] = MetricSummary(own.integer("count", 1, 1 << 53), total, low, high)
    return read
