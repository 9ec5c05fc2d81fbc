"""Dividing cores between engines and the learner."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from ludus.engine.affinity import CorePlan, allowed_cores, plan_cores


@pytest.mark.parametrize(
    ("num_engines", "allowed", "engines", "learner"),
    [
        (1, (0, 1), [(0,)], (1,)),
        (2, (0, 1), [(0,), (1,)], (0, 1)),
        (3, (4, 6), [(4,), (6,), (4,)], (4, 6)),
        (3, (0, 2, 4, 6, 8), [(0,), (2,), (4,)], (6, 8)),
        (1, (5,), [(5,)], (5,)),
        (0, (0, 1), [], (0, 1)),
    ],
)
def test_cores_are_divided(
    num_engines: int,
    allowed: tuple[int, ...],
    engines: list[tuple[int, ...]],
    learner: tuple[int, ...],
) -> None:
    assert plan_cores(num_engines, allowed) == CorePlan(tuple(engines), learner)


def test_allowed_cores_are_used_by_default() -> None:
    allowed = tuple(sorted(os.sched_getaffinity(0)))
    assert allowed_cores() == allowed
    assert plan_cores(1).engines == (allowed[:1],)


def test_without_pinning_there_is_no_plan(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "darwin")
    assert allowed_cores() is None
    assert plan_cores(2) == CorePlan((None, None), None)


def test_whole_process_is_pinned() -> None:
    code = """
import os, threading
from ludus.engine.affinity import pin_current_process
gate = threading.Barrier(2)
seen = []
def look():
    gate.wait(); gate.wait()
    seen.append(sorted(os.sched_getaffinity(0)))
thread = threading.Thread(target=look)
thread.start()
gate.wait()
pin_current_process(None)
core = max(os.sched_getaffinity(0))
pin_current_process((core,))
gate.wait()
thread.join()
assert seen == [[core]] == [sorted(os.sched_getaffinity(0))], seen
"""
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)
