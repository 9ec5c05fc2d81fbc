"""Metrics to Weights & Biases, MLflow and Trackio: the numbers of ``metrics.jsonl``, as they are.

Where they go is each tracker's own business: ``WANDB_PROJECT``, ``WANDB_MODE``,
``MLFLOW_TRACKING_URI``, ``MLFLOW_EXPERIMENT_NAME``, ``TRACKIO_DIR`` and so on hold as usual. A
resumed run goes on in the same run of the tracker, whose name the run folder keeps.
"""

from __future__ import annotations

import contextlib
import importlib.util
import json
import logging
import os
import re
import sys
import time
import uuid
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

from ludus.disk import disk_errors, write_atomically
from ludus.errors import SetupError
from ludus.settings.plain import flatten_settings, to_plain
from ludus.settings.train_config import Sink, TrainConfig

__all__ = ["Tracker", "open_trackers", "require_trackers"]

PROJECT = "ludus"
NAMES = "tracking.json"
"""File in the run folder with the name of the run in each tracker."""
MLFLOW_BATCH = 100
"""Parameters that MLflow takes at once."""

log = logging.getLogger(__name__)


class Tracker(Protocol):
    """Takes the metrics of a run."""

    def write(self, step: int, scalars: Mapping[str, float]) -> None:
        """Take the scalars of one update; ``step`` is the agent steps so far."""
        ...

    def close(self) -> None:
        """Send what has not been sent yet."""
        ...


def require_trackers(sinks: Sequence[Sink]) -> None:
    """Make sure that the packages of some trackers are installed.

    Raises:
        SetupError: One is missing.
    """
    for sink in sinks:
        if importlib.util.find_spec(sink) is None:
            raise SetupError(f"{sink} is not installed", f"pip install {sink}")


def open_trackers(config: TrainConfig, folder: Path) -> list[Tracker]:
    """Open the trackers that the settings of a run name.

    Args:
        config: Settings of the run.
        folder: Of the run.

    Raises:
        SetupError: A package is missing, or a tracker cannot be reached.
    """
    require_trackers(config.track)
    trackers: list[Tracker] = []
    for sink in config.track:
        try:
            with _stdout_to_stderr():
                opened = _OPEN[sink](folder, to_plain(config))
        except Exception as error:
            for tracker in trackers:
                tracker.close()
            raise SetupError(
                f"--track {sink}: {type(error).__name__}: {error}",
                f"leave --track {sink} out, or see the documentation of {sink}",
            ) from error
        trackers.append(_Forgiving(sink, opened))
    return trackers


class _Forgiving:
    """Passes metrics on; a tracker that fails is left out from then on, and training goes on."""

    def __init__(self, sink: Sink, tracker: Tracker) -> None:
        self._sink = sink
        self._tracker = tracker
        self._has_failed = False

    def write(self, step: int, scalars: Mapping[str, float]) -> None:
        self._try(lambda: self._tracker.write(step, scalars), f"from step {step} on")

    def close(self) -> None:
        self._try(self._tracker.close, "at the end")

    def _try(self, do: Callable[[], None], when: str) -> None:
        if self._has_failed:
            return
        try:
            with _stdout_to_stderr():
                do()
        except Exception as error:
            self._has_failed = True
            log.warning(
                "%s gets no metrics %s: %s: %s; metrics.jsonl has them all",
                self._sink, when, type(error).__name__, error,
            )  # fmt: skip


def _stdout_to_stderr() -> contextlib.redirect_stdout[Any]:
    """Keep what a tracker prints out of the output of a command."""
    return contextlib.redirect_stdout(sys.stderr)


class _Wandb:
    def __init__(self, folder: Path, config: Mapping[str, Any]) -> None:
        wandb: Any = importlib.import_module("wandb")
        self._run: Any = wandb.init(
            project=os.environ.get("WANDB_PROJECT", PROJECT),
            name=folder.name,
            id=_run_name(folder, "wandb"),
            resume="allow",
            dir=str(folder),
            config=config,
        )
        # The x axis is a metric, so that the steps that a resumed run repeats are shown.
        self._run.define_metric("*", step_metric="run/agent_steps")

    def write(self, step: int, scalars: Mapping[str, float]) -> None:
        self._run.log(dict(scalars))

    def close(self) -> None:
        self._run.finish()


class _Mlflow:
    def __init__(self, folder: Path, config: Mapping[str, Any]) -> None:
        self._entities: Any = importlib.import_module("mlflow.entities")
        self._client: Any = importlib.import_module("mlflow.tracking").MlflowClient()
        name = os.environ.get("MLFLOW_EXPERIMENT_NAME", PROJECT)
        experiment = self._client.get_experiment_by_name(name)
        number = self._client.create_experiment(name) if experiment is None else (
            experiment.experiment_id
        )  # fmt: skip
        self._run_id = _run_name(folder, "mlflow", "")
        if self._run_id:
            self._client.update_run(self._run_id, status="RUNNING")
            return
        self._run_id = self._client.create_run(number, run_name=folder.name).info.run_id
        _keep_name(folder, "mlflow", self._run_id)
        params = [
            self._entities.Param(name, str(value)[:500])
            for name, value in flatten_settings(config).items()
            if value != {}
        ]
        for start in range(0, len(params), MLFLOW_BATCH):
            self._client.log_batch(self._run_id, params=params[start : start + MLFLOW_BATCH])

    def write(self, step: int, scalars: Mapping[str, float]) -> None:
        now = int(time.time() * 1000)
        metrics = [
            self._entities.Metric(re.sub(r"[^\w\-. :/]", "_", name), value, now, step)
            for name, value in scalars.items()
        ]
        self._client.log_batch(self._run_id, metrics=metrics)

    def close(self) -> None:
        self._client.set_terminated(self._run_id, "FINISHED")


class _Trackio:
    def __init__(self, folder: Path, config: Mapping[str, Any]) -> None:
        self._trackio: Any = importlib.import_module("trackio")
        self._trackio.init(
            project=os.environ.get("TRACKIO_PROJECT", PROJECT),
            name=_run_name(folder, "trackio", folder.name),
            resume="allow",
            config=dict(config),
            embed=False,
        )

    def write(self, step: int, scalars: Mapping[str, float]) -> None:
        self._trackio.log(dict(scalars), step=step)

    def close(self) -> None:
        self._trackio.finish()


_OPEN: dict[Sink, Callable[[Path, Mapping[str, Any]], Tracker]] = {
    "wandb": _Wandb,
    "mlflow": _Mlflow,
    "trackio": _Trackio,
}


def _run_name(folder: Path, sink: Sink, new: str | None = None) -> str:
    """Return the name of the run in a tracker; a new one is random unless given, and is kept."""
    names = _read_names(folder)
    if sink in names:
        return names[sink]
    name = uuid.uuid4().hex[:12] if new is None else new
    if name:
        _keep_name(folder, sink, name)
    return name


def _keep_name(folder: Path, sink: Sink, name: str) -> None:
    with disk_errors(str(folder / NAMES)):
        values = {**_read_names(folder), sink: name}
        write_atomically(folder / NAMES, json.dumps(values).encode())


def _read_names(folder: Path) -> dict[str, str]:
    try:
        return json.loads((folder / NAMES).read_bytes())
    except (OSError, ValueError):
        return {}
