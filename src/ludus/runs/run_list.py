"""What the runs in a folder have come to, from the small files that they leave."""

from __future__ import annotations

import math
import typing
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, Literal, cast

from ludus.disk import parse_json, plain_file_opener, read_json
from ludus.errors import RunError
from ludus.printing import printable
from ludus.runs.run_folder import RunFolder

__all__ = ["PolicySummary", "RunState", "RunSummary", "StopReason", "list_runs", "parse_metrics",
           "running_runs", "sample_metrics"]  # fmt: skip

StopReason = Literal["total_steps", "max_time", "target_return", "stopped", "interrupted"]
"""Why training ended; ``stopped`` by the game, ``ludus control`` or a callback, ``interrupted`` by
a signal."""

RunState = Literal["running", "finished", "stopped", "interrupted", "diverged", "failed", "crashed"]
"""``running``: a process holds it; ``finished``: a limit was reached; ``stopped``: by the game,
``ludus control`` or a callback; ``interrupted``: by a signal; ``diverged``: a loss became NaN;
``failed``: by an error, of a callback or of the game; ``crashed``: it ended without saying how."""

CURVE_POINTS = 48
MAX_BYTES = MAX_LINE_BYTES = 1 << 20
TAIL_BYTES = 1 << 18
"""Files of metrics up to this size are read as a whole."""
REASONS: tuple[str, ...] = typing.get_args(StopReason)


@dataclass(frozen=True)
class PolicySummary:
    """One policy of a run.

    Attributes:
        mean_return: Of the last episodes; None before the first one ended.
        curve: Mean returns from the start to now, evenly spaced; empty before that.
        elo: Rating; None without self-play.
        evaluation: Mean return of the evaluation at the end; None without one.
    """

    mean_return: float | None
    curve: tuple[float, ...]
    elo: float | None
    evaluation: float | None


@dataclass(frozen=True)
class RunSummary:
    """One run.

    Attributes:
        path: Its folder.
        target: What is trained in.
        state: Whether and how it has ended.
        stop_reason: Why it ended, as in :class:`~ludus.training.progress.RunResult`; None while it
            runs and after a crash.
        started_at: When it was started or last resumed, seconds since 1970.
        agent_steps: Agent steps so far.
        updates: Updates so far.
        wall_s: Seconds of training so far.
        policies: By name.
        game: Newest mean of each metric that the game reports, by name.
    """

    path: Path
    target: str
    state: RunState
    stop_reason: str | None
    started_at: float
    agent_steps: int
    updates: int
    wall_s: float
    policies: dict[str, PolicySummary]
    game: dict[str, float]


def list_runs(folder: Path) -> list[RunSummary]:
    """Return the runs in a folder, or the run that it is, the last one started first.

    What is no run is passed over, and damaged files say nothing.

    Raises:
        OSError: ``folder`` is none, or may not be read.
    """
    paths = [folder] if _config(folder) else list(folder.iterdir())
    found = [run for path in paths if (run := _summary(path)) is not None]
    return sorted(found, key=lambda run: (run.started_at, run.path.name), reverse=True)


def running_runs(folder: Path) -> list[RunFolder]:
    """Return the runs in a folder that a process is training now; none if there is no folder."""
    if not folder.is_dir():
        return []
    runs = (RunFolder(path) for path in sorted(folder.iterdir()) if _config(path))
    return [run for run in runs if _is_running(run)]


def _summary(path: Path) -> RunSummary | None:
    config = _config(path)
    if not config:
        return None
    folder = RunFolder(path)
    lines = sample_metrics(folder.metrics, CURVE_POINTS)
    is_running = _is_running(folder)
    result = {} if is_running else _read_object(folder.result)
    last: Mapping[str, Any] = result or (lines[-1] if lines else {})
    reason = result.get("stop_reason")
    return RunSummary(
        path=path,
        target=printable(config["target"]),
        state="running" if is_running else _state(reason),
        stop_reason=reason if isinstance(reason, str) else None,
        started_at=(path / "config.json").stat().st_mtime,
        agent_steps=int(_number(last, "agent_steps") or 0),
        updates=int(_number(last, "updates") or 0),
        wall_s=_number(last, "wall_s") or 0.0,
        policies={
            printable(name): _policy(lines, name, _number(_object(result, "evaluation"), name))
            for name in _object(config, "policies")
        },
        game=_game(lines),
    )


def _policy(
    lines: Sequence[Mapping[str, Any]], name: str, evaluation: float | None
) -> PolicySummary:
    of_policy = [_object(line["policies"], name) for line in lines]
    returns = [_number(values, "mean_return") for values in of_policy]
    curve = tuple(value for value in returns if value is not None)
    return PolicySummary(
        mean_return=curve[-1] if curve else None,
        curve=curve,
        elo=_number(of_policy[-1], "elo") if of_policy else None,
        evaluation=evaluation,
    )


def _game(lines: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    means: dict[str, float] = {}
    for line in lines:
        game = _object(line, "game")
        for name in game:
            mean = _number(_object(game, name), "mean")
            if mean is not None:
                means[printable(name)] = mean
    return means


def _state(reason: object) -> RunState:
    if reason in {"stopped", "interrupted", "diverged", "failed"}:
        return cast(RunState, reason)
    return "finished" if reason in REASONS else "crashed"


def _is_running(folder: RunFolder) -> bool:
    try:
        return folder.is_running()
    except RunError:  # somebody else's, or on a disk that cannot be written to
        return False


def _config(path: Path) -> dict[str, Any]:
    """Return the settings of a run; empty if ``path`` is none."""
    config = _read_object(path / "config.json")
    return config if isinstance(config.get("target"), str) else {}


def _read_object(path: Path) -> dict[str, Any]:
    """Return the object in a small JSON file; empty if there is none to be read."""
    try:
        values: Any = read_json(path, MAX_BYTES)
    except (OSError, ValueError):
        return {}
    return cast(dict[str, Any], values) if isinstance(values, dict) else {}


def _object(values: Mapping[str, Any], name: str) -> dict[str, Any]:
    value = values.get(name)
    return cast(dict[str, Any], value) if isinstance(value, dict) else {}


def _number(values: Mapping[str, Any], name: str) -> float | None:
    value = values.get(name)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return None
    return float(value)


# --- a few lines out of a metrics.jsonl, however long it is ------------------------------------


def sample_metrics(path: Path, count: int) -> list[dict[str, Any]]:
    """Return at most ``count`` lines, evenly spaced over the file, and the last one besides.

    A run of days writes hundreds of megabytes; a curve of a few dozen points needs as many lines.
    Other lines than metrics of an update are left out, such as those cut short by a kill.
    """
    try:
        with open(path, "rb", opener=plain_file_opener) as file:
            size = file.seek(0, 2)
            file.seek(max(0, size - TAIL_BYTES))
            tail = file.read(TAIL_BYTES).splitlines()
            if size > TAIL_BYTES:
                found = _sample_long(file, size, count)
            else:
                lines = [line for text in tail if (line := parse_metrics(text))]
                chosen = {len(lines) * index // count for index in range(count)}
                found = [lines[index] for index in sorted(chosen)] if lines else []
    except OSError:
        return []
    last = next((line for text in reversed(tail) if (line := parse_metrics(text))), None)
    if last is not None and (not found or found[-1]["agent_steps"] < last["agent_steps"]):
        found.append(last)
    return found


def _sample_long(file: BinaryIO, size: int, count: int) -> list[dict[str, Any]]:
    """Return the lines that begin after ``count`` evenly spaced places of a file."""
    found: list[dict[str, Any]] = []
    read_until = -1
    for index in range(count):
        place = size * index // count
        if place < read_until:
            continue  # the line that was read last reaches beyond
        file.seek(max(0, place - 1))
        if place:
            file.readline(MAX_LINE_BYTES)  # the rest of a line that began before
        line = parse_metrics(file.readline(MAX_LINE_BYTES))
        read_until = file.tell()
        if line is not None:
            found.append(line)
    return found


def parse_metrics(text: bytes) -> dict[str, Any] | None:
    """Return a line as :class:`~ludus.runs.metrics.MetricsLog` writes it, None for others."""
    try:
        line: Any = parse_json(text)
    except ValueError:
        return None
    if not isinstance(line, dict):
        return None
    values = cast(dict[str, Any], line)
    policies = values.get("policies")
    if not isinstance(policies, dict) or _number(values, "agent_steps") is None:
        return None
    named = cast(dict[str, Any], policies).values()
    return values if all(isinstance(of, dict) for of in named) else None
