"""Cores of real engines."""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path

import pytest

from ludus.engine import allowed_cores
from ludus.pool import EnginePool, PoolConfig, open_pool
from ludus.spec.batch import ActionBatch

pytestmark = [
    pytest.mark.engine,
    pytest.mark.skipif(
        sys.platform != "linux" or len(allowed_cores() or ()) < 2, reason="needs two cores"
    ),
]


def pid(pool: EnginePool, engine: int = 0) -> int:
    session = pool.sessions[engine]
    assert session.pid
    return session.pid


def step(pool: EnginePool) -> None:
    pool.step({"cart": ActionBatch.zeros(pool.policies["cart"], pool.num_agents("cart"))})


def cores_of_threads(pool: EnginePool, engine: int = 0) -> set[frozenset[int]]:
    tasks = Path(f"/proc/{pid(pool, engine)}/task").iterdir()
    return {frozenset(os.sched_getaffinity(int(task.name))) for task in tasks}


def test_engines_of_two_pools_run_on_different_cores(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Pools of other tests hold locks in the usual cache.
    monkeypatch.setattr("ludus.engine.affinity.cache_root", lambda: tmp_path)
    cores = allowed_cores()
    assert cores
    first_core, second_core = cores[:2]
    with open_pool("cartpole") as first, open_pool("cartpole", PoolConfig(max_restarts=1)) as pool:
        assert os.sched_getaffinity(pid(first)) == {first_core}
        assert os.sched_getaffinity(pid(pool)) == {second_core}
        first.close()
        pool.reset(0)
        os.kill(pid(pool), signal.SIGKILL)
        step(pool)
        assert pool.num_restarts == 1
        assert os.sched_getaffinity(pid(pool)) == {second_core}
        with open_pool("cartpole") as third:
            assert os.sched_getaffinity(pid(third)) == {first_core}


def test_nobody_is_pinned_while_there_are_more_engines_than_cores(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ludus.engine.affinity.cache_root", lambda: tmp_path)
    monkeypatch.setattr("ludus.engine.affinity._LOOK_S", 0.0)
    cores = (allowed_cores() or ())[:2]
    monkeypatch.setattr("ludus.engine.affinity.allowed_cores", lambda: cores)
    first, second = ({frozenset({core})} for core in cores)
    unpinned = {frozenset(cores)}

    def step_twice() -> None:
        for pool in (pair, single):
            step(pool)

    with open_pool("cartpole") as single:
        single.reset(0)
        assert cores_of_threads(single) == first
        with open_pool("cartpole", PoolConfig(num_engines=2, max_restarts=1)) as pair:
            pair.reset(0)
            step_twice()
            for pool, engine in ((single, 0), (pair, 0), (pair, 1)):
                assert cores_of_threads(pool, engine) == unpinned
            os.kill(pid(pair), signal.SIGKILL)
            step_twice()
            assert pair.num_restarts == 1 and cores_of_threads(pair) == unpinned
            single.close()
            step(pair)
            assert [cores_of_threads(pair, engine) for engine in (0, 1)] == [first, second]
