"""Event files for TensorBoard, written at once and in this thread, so that errors come out."""

from __future__ import annotations

import importlib
import socket
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tensorboard.summary.writer.record_writer import RecordWriter

from ludus.disk import disk_errors

__all__ = ["EventFile"]

# Generated modules, which have no types.
_events: Any = importlib.import_module("tensorboard.compat.proto.event_pb2")
_summaries: Any = importlib.import_module("tensorboard.compat.proto.summary_pb2")


class EventFile:
    """A new event file in a run folder.

    ``tensorboard --logdir runs`` joins the files of a run; what older ones hold beyond
    ``first_step`` is dropped, as the run was resumed from there.
    """

    def __init__(self, folder: Path, first_step: int) -> None:
        name = f"events.out.tfevents.{time.time():.0f}.{socket.gethostname()}.{time.time_ns()}"
        self._folder = folder
        with disk_errors(f"the TensorBoard log in {folder}"):
            self._file = (folder / name).open("wb")
        self._records: Any = RecordWriter(self._file)
        self._write(_events.Event(wall_time=time.time(), file_version="brain.Event:2"))
        start = _events.SessionLog(status=_events.SessionLog.START)
        self._write(_events.Event(wall_time=time.time(), step=first_step, session_log=start))

    def write(self, step: int, scalars: Mapping[str, float]) -> None:
        """Write scalars by tag."""
        values = [_summaries.Summary.Value(tag=k, simple_value=v) for k, v in scalars.items()]
        summary = _summaries.Summary(value=values)
        self._write(_events.Event(wall_time=time.time(), step=step, summary=summary))

    def close(self) -> None:
        """Close the file."""
        with disk_errors(f"the TensorBoard log in {self._folder}"):
            self._file.close()

    def _write(self, event: Any) -> None:
        with disk_errors(f"the TensorBoard log in {self._folder}"):
            self._records.write(event.SerializeToString())
            self._file.flush()
