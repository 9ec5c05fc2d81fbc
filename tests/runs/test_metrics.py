"""The files that metrics are written to."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import psutil
import pytest

from ludus.runs.metrics import MetricsLog


class Tracker:
    """One that may not be able to close."""

    def __init__(self, *, is_stubborn: bool = False) -> None:
        self.is_closed = False
        self._is_stubborn = is_stubborn

    def write(self, step: int, scalars: Mapping[str, float]) -> None:
        """Take nothing."""

    def close(self) -> None:
        if self._is_stubborn:
            raise KeyboardInterrupt
        self.is_closed = True


@pytest.mark.parametrize("stubborn", range(3))
def test_a_tracker_that_cannot_close_leaves_nothing_else_open(
    tmp_path: Path, stubborn: int
) -> None:
    trackers = [Tracker(is_stubborn=index == stubborn) for index in range(3)]
    metrics = MetricsLog(tmp_path, trackers=trackers)
    assert len(open_files(tmp_path)) == 2
    with pytest.raises(KeyboardInterrupt):
        metrics.close()
    assert [tracker.is_closed for tracker in trackers].count(False) == 1
    assert open_files(tmp_path) == []


def open_files(folder: Path) -> list[str]:
    """Return the files of a folder that this process has open."""
    return [path for path, *_ in psutil.Process().open_files() if Path(path).parent == folder]
