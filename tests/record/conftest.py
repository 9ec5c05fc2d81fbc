"""Nothing may be left behind: no process, no thread, no half-written file."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.legacy.gymgodot.conftest import left_processes, left_threads


@pytest.fixture
def films(tmp_path: Path) -> Iterator[Path]:
    """A folder for films."""
    before = set(threading.enumerate())
    folder = tmp_path / "films"
    folder.mkdir()
    yield folder
    assert left_processes() == []
    assert left_threads(before) == set()
    assert [file for file in folder.iterdir() if file.name.startswith(".")] == []
