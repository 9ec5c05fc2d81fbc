"""Weights & Biases, MLflow and Trackio, offline: they get the very numbers of metrics.jsonl."""

# WandB's types are incomplete.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownParameterType=false
# pyright: reportUnknownLambdaType=false

from __future__ import annotations

import json
import sqlite3
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import ludus
from ludus.errors import SetupError
from ludus.runs import tracking

TARGET = "gym:CartPole-v1"
SMALL: dict[str, Any] = {
    "num_worlds": 2, "num_engines": 1, "seed": 1, "total_steps": 96, "evaluation_episodes": 0,
    "name": "tracked", "ppo": {"rollout_steps": 16}, "checkpoint_every_updates": 1,
}  # fmt: skip


def expected(run: ludus.Run) -> dict[str, list[float]]:
    """Return the values of every metric, update by update, by its tag."""
    values: dict[str, list[float]] = {}
    for line in run.metrics:
        scalars = {f"run/{name}": value for name, value in line.items() if name != "policies"}
        for policy, own in line["policies"].items():
            scalars |= {f"{policy}/{name}": value for name, value in own.items()}
        for tag, value in scalars.items():
            values.setdefault(tag, []).append(float(value))
    return values


@pytest.mark.libraries
@pytest.mark.filterwarnings("default")
def test_wandb_has_the_same_numbers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WANDB_MODE", "offline")
    monkeypatch.setenv("WANDB_SILENT", "true")
    run = ludus.train(TARGET, runs=tmp_path, track=["wandb"], **SMALL)
    ludus.train(resume=run.path, total_steps=160)
    values: dict[str, list[float]] = {}
    for file in sorted((run.path / "wandb").glob("offline-run-*/run-*.wandb")):
        for item in history(file):
            for tag, value in item.items():
                values.setdefault(tag, []).append(value)
    found = {tag: got for tag, got in values.items() if not tag.startswith("_")}
    assert found == expected(run)


def history(file: Path) -> list[dict[str, float]]:
    """Return what an offline run of Weights & Biases has logged."""
    from wandb.proto import wandb_internal_pb2

    proto: Any = wandb_internal_pb2

    items: list[dict[str, float]] = []
    for data in log_records(file.read_bytes()):
        record: Any = proto.Record()
        record.ParseFromString(data)
        if record.HasField("history"):
            items.append({
                item.key or "/".join(item.nested_key): json.loads(item.value_json)
                for item in record.history.item
            })  # fmt: skip
    return items


def log_records(data: bytes) -> Iterator[bytes]:
    """Yield the records of a log in LevelDB's format: blocks of 32 KiB, 7 bytes before a part."""
    place, parts = 7, b""
    while place + 7 <= len(data):
        left = 32768 - place % 32768
        if left < 7:
            place += left
            continue
        size, kind = struct.unpack_from("<HB", data, place + 4)
        parts += data[place + 7 : place + 7 + size]
        place += 7 + size
        if kind in {1, 4}:  # whole, or the last part
            yield parts
            parts = b""


@pytest.mark.libraries
@pytest.mark.filterwarnings("default")
def test_mlflow_has_the_same_numbers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from mlflow.tracking import MlflowClient

    monkeypatch.setenv("MLFLOW_TRACKING_URI", f"sqlite:///{tmp_path}/mlflow.db")
    run = ludus.train(TARGET, runs=tmp_path, track=["mlflow"], **SMALL)
    ludus.train(resume=run.path, total_steps=160)
    client: Any = MlflowClient()
    (found,) = client.search_runs([client.get_experiment_by_name("ludus").experiment_id])
    assert found.data.params["policies.agent.rollout_steps"] == "16"
    assert found.info.status == "FINISHED"
    for tag, values in expected(run).items():
        measured = client.get_metric_history(found.info.run_id, tag)
        assert [metric.value for metric in sorted(measured, key=lambda each: each.step)] == values


@pytest.mark.libraries
@pytest.mark.filterwarnings("default")
def test_trackio_has_the_same_numbers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import trackio.utils

    monkeypatch.setattr(trackio.utils, "TRACKIO_DIR", tmp_path / "trackio", raising=False)
    monkeypatch.setattr("trackio.sqlite_storage.TRACKIO_DIR", tmp_path / "trackio", raising=False)
    run = ludus.train(TARGET, runs=tmp_path, track=["trackio"], **SMALL)
    ludus.train(resume=run.path, total_steps=160)
    with sqlite3.connect(tmp_path / "trackio" / "ludus.db") as database:
        rows = database.execute("SELECT metrics FROM metrics ORDER BY step").fetchall()
    values: dict[str, list[float]] = {}
    for (text,) in rows:
        for tag, value in json.loads(text).items():
            values.setdefault(tag, []).append(value)
    assert values == expected(run)


def test_a_tracker_that_is_not_installed_is_one_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tracking.importlib.util, "find_spec", lambda _: None)
    with pytest.raises(SetupError, match=r"mlflow is not installed\nhint: pip install mlflow"):
        ludus.train(TARGET, runs=tmp_path, track=["mlflow"], **SMALL)
    assert not list(tmp_path.iterdir())


class Broken:
    def __init__(self, *_: Any) -> None:
        self.steps: list[int] = []

    def write(self, step: int, scalars: Any) -> None:
        self.steps.append(step)
        if step > 32:
            raise ConnectionError("the server has gone")

    def close(self) -> None:
        self.steps.append(-1)


def test_a_tracker_that_fails_does_not_end_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    broken = Broken()
    monkeypatch.setattr(tracking, "require_trackers", lambda _: None)
    monkeypatch.setattr("ludus.training.loop.require_trackers", lambda _: None)
    monkeypatch.setitem(tracking._OPEN, "wandb", lambda *_: broken)  # pyright: ignore
    run = ludus.train(TARGET, runs=tmp_path, track=["wandb"], **SMALL)
    assert len(run.metrics) == 3
    assert broken.steps == [32, 64]
    assert "wandb gets no metrics from step 64 on: ConnectionError: the server" in caplog.text
