"""Dividing cores between engines and the learner."""

from __future__ import annotations

import contextlib
import os
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from ludus.engine import affinity
from ludus.engine.affinity import (
    CorePlan,
    allowed_cores,
    cpu_quota,
    num_cores,
    plan_cores,
    reserve_cores,
)


@pytest.mark.parametrize(
    ("num_engines", "allowed", "engines", "learner"),
    [
        (1, (0, 1), [(0,)], (1,)),
        (2, (0, 1), [(0,), (1,)], (0, 1)),
        (3, (4, 6), [None, None, None], None),
        (3, (0, 2, 4, 6, 8), [(0,), (2,), (4,)], (6, 8)),
        (1, (5,), [(5,)], (5,)),
        (0, (0, 1), [], (0, 1)),
    ],
)
def test_cores_are_divided(
    num_engines: int,
    allowed: tuple[int, ...],
    engines: list[tuple[int, ...] | None],
    learner: tuple[int, ...] | None,
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


HOLDER = """
import sys
from ludus.engine import affinity
affinity.allowed_cores = lambda: (4, 6)
cores = affinity.reserve_cores(int(sys.argv[1]))
print([pinned[0] for pinned in cores.plan.engines if pinned], flush=True)
sys.stdin.readline()
cores.close()
print("closed", flush=True)
sys.stdin.readline()
"""


@pytest.fixture
def two_cores(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder of the locks, in a cache of its own, on a machine with cores 4 and 6."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(affinity, "allowed_cores", lambda: (4, 6))
    monkeypatch.setattr(affinity, "_LOOK_S", 0.0)
    return tmp_path / "ludus" / "cores" / socket.gethostname()


@pytest.fixture
def hold() -> Iterator[Callable[[int], subprocess.Popen[str]]]:
    """Return what starts another process with a pool of that many engines."""
    with contextlib.ExitStack() as processes:

        def start(num_engines: int) -> subprocess.Popen[str]:
            pipe = subprocess.PIPE
            command = [sys.executable, "-c", HOLDER, str(num_engines)]
            process = processes.enter_context(
                subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True)
            )
            processes.callback(process.kill)
            return process

        yield start


def read(process: subprocess.Popen[str]) -> str:
    assert process.stdout is not None
    return process.stdout.readline().strip()


def go_on(process: subprocess.Popen[str]) -> None:
    assert process.stdin is not None
    process.stdin.write("\n")
    process.stdin.flush()


@pytest.mark.skipif(sys.platform != "linux", reason="pinning")
@pytest.mark.usefixtures("two_cores")
def test_processes_take_different_cores(hold: Callable[[int], subprocess.Popen[str]]) -> None:
    first, second = hold(1), hold(1)
    assert sorted([read(first), read(second)]) == ["[4]", "[6]"]
    third = hold(2)
    assert read(third) == "[]"  # all are taken: nothing is pinned
    go_on(second)
    assert read(second) == "closed"
    first.kill()
    first.wait()
    with reserve_cores(1) as cores:
        assert cores.plan == CorePlan((None,), None)  # the third waits, and is not looking now
        third.kill()
        third.wait()
        assert cores.look_again()
        assert cores.plan == CorePlan(((4,),), (6,))


@pytest.mark.usefixtures("two_cores")
def test_pools_that_wait_for_cores_have_all_others_unpin() -> None:
    def look_again() -> list[bool]:
        return [pool.look_again() for pool in (first, second, third)]

    unpinned = CorePlan((None,), None)
    first, second, third = (reserve_cores(1) for _ in range(3))
    assert [first.plan, second.plan, third.plan] == [
        CorePlan(((4,),), (6,)), CorePlan(((6,),), (4, 6)), unpinned
    ]  # fmt: skip
    assert look_again() == [True, True, False]
    assert first.plan == second.plan == unpinned
    with reserve_cores(2) as fourth:
        third.close()
        assert look_again() == [True, True, False]  # nobody has told them of the fourth yet
        fourth.look_again()
        assert look_again() == [True, True, False]
        first.close()
        second.close()
        assert fourth.look_again()
        assert fourth.plan == CorePlan(((4,), (6,)), (4, 6))


@pytest.mark.usefixtures("two_cores")
def test_pools_of_one_process_take_different_cores() -> None:
    with reserve_cores(1) as first:
        assert first.plan == CorePlan(((4,),), (6,))
        second = reserve_cores(1)
        assert second.plan == CorePlan(((6,),), (4, 6))
        second.close()
        second.close()
        with reserve_cores(2) as third:  # one core is free, which is too few
            assert third.plan == CorePlan((None, None), None)
    assert reserve_cores(1).plan.engines == ((4,),)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="fork")
@pytest.mark.usefixtures("two_cores")
def test_a_forked_copy_does_not_free_the_core() -> None:
    with reserve_cores(1) as cores:
        pid = os.fork()
        if pid == 0:
            cores.close()
            os._exit(0)
        os.waitpid(pid, 0)
        assert reserve_cores(1).plan.engines == ((6,),)


def test_a_cache_that_cannot_be_written_to(two_cores: Path) -> None:
    two_cores.parents[1].mkdir()
    two_cores.parent.write_text("no folder")
    with reserve_cores(1) as first, reserve_cores(1) as second:
        assert first.plan == second.plan == CorePlan(((4,),), (6,))


def test_a_lock_file_that_cannot_be_opened(two_cores: Path) -> None:
    (two_cores / "core-6.lock").mkdir(parents=True)
    with reserve_cores(2) as first, reserve_cores(1) as second:
        assert first.plan.engines == ((4,), (6,))
        assert second.plan.engines == ((4,),)  # nothing is left locked


@pytest.mark.parametrize(
    ("groups", "files", "quota"),
    [
        ("0::/a/b\n", {"a/b/cpu.max": "max 100000", "a/cpu.max": "150000 100000"}, 1.5),
        ("0::/host/path\n", {"cpu.max": "50000 100000"}, 0.5),  # in a container
        ("3:cpu,cpuacct:/c\n0::/\n", {
            "cpu,cpuacct/c/cpu.cfs_quota_us": "200000",
            "cpu,cpuacct/c/cpu.cfs_period_us": "100000",
        }, 2.0),
        ("3:cpu:/c\n", {"cpu/c/cpu.cfs_quota_us": "-1", "cpu/c/cpu.cfs_period_us": "100000"}, None),
        ("0::/\n", {}, None),
    ],
)  # fmt: skip
def test_the_smallest_quota_of_all_control_groups_counts(
    tmp_path: Path, groups: str, files: dict[str, str], quota: float | None
) -> None:
    mount = {f"sys/fs/cgroup/{name}": text for name, text in files.items()}
    for name, text in {"proc/self/cgroup": groups, **mount}.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    assert cpu_quota(tmp_path) == quota


@pytest.mark.usefixtures("two_cores")
def test_under_a_quota_nothing_is_pinned(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(affinity, "cpu_quota", lambda: 1.5)
    assert num_cores() == 1.5
    assert reserve_cores(1).plan == CorePlan((None,), None)


@pytest.mark.usefixtures("two_cores")
def test_without_platformdirs_cores_are_not_reserved(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "platformdirs", None)
    with reserve_cores(1) as first, reserve_cores(1) as second:
        assert first.plan == second.plan
