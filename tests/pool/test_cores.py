"""Cores of real engines."""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path

import numpy as np
import pytest

from ludus.engine import allowed_cores
from ludus.pool import EnginePool, PoolConfig, open_pool
from ludus.session.engine_session import EngineSession
from ludus.spec.batch import ActionBatch

pytestmark = [
    pytest.mark.engine,
    pytest.mark.skipif(
        sys.platform != "linux" or len(allowed_cores() or ()) < 2, reason="needs two cores"
    ),
]


def pid(pool: EnginePool) -> int:
    session = pool.sessions[0]
    assert isinstance(session, EngineSession) and session.pid
    return session.pid


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
        action = ActionBatch(np.zeros((1, 1), np.int64), np.zeros((1, 0), np.float32))
        pool.step({"cart": action})
        assert pool.num_restarts == 1
        assert os.sched_getaffinity(pid(pool)) == {second_core}
        with open_pool("cartpole") as third:
            assert os.sched_getaffinity(pid(third)) == {first_core}
