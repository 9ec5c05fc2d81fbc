"""Collecting experience: engines simulate while the learners work for another engine."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from ludus.batch import Batch
from ludus.pool.interface import Pool
from ludus.train.episodes import EpisodeTracker
from ludus.train.learner import Learner

__all__ = ["CollectTimes", "Collector"]


@dataclass
class CollectTimes:
    """Where the time of collecting went, seconds in sum.

    Attributes:
        wait_s: Waiting for engines.
        act_s: Choosing actions and sending them.
        record_s: Recording what came back.
        learn_s: Learning while engines simulated.
    """

    wait_s: float = 0.0
    act_s: float = 0.0
    record_s: float = 0.0
    learn_s: float = 0.0


class Collector:
    """Steps all engines of a pool, with one learner for each policy.

    Engines take turns in a fixed order, so that equal seeds give equal runs: receive from one,
    choose its next actions, send them, go on to the next. While actions are chosen for one engine
    all the others simulate.
    """

    def __init__(
        self, pool: Pool, learners: Mapping[str, Learner], trackers: Mapping[str, EpisodeTracker]
    ) -> None:
        self._pool = pool
        self._learners = learners
        self._trackers = trackers
        self._engines = range(pool.num_engines)
        self._rows = [{name: pool.rows(name, k) for name in learners} for k in self._engines]
        self.times = CollectTimes()

    @property
    def num_steps(self) -> int:
        """Agent steps so far, of all policies."""
        return sum(tracker.num_steps for tracker in self._trackers.values())

    def reset(self, seed: int) -> None:
        """Begin new episodes everywhere; drops what no learner has learnt from yet."""
        batches = self._pool.reset(seed)
        for engine in self._engines:
            for name, learner in self._learners.items():
                rows = self._rows[engine][name]
                first = first_rows(batches[name], rows)
                learner.begin(engine, first)
                self._trackers[name].begin(rows, first)

    def collect(self, is_stopping: Callable[[], bool]) -> bool:
        """Step until a learner is due to update.

        Args:
            is_stopping: Asked before each step.

        Returns:
            Whether that was reached; False if ``is_stopping`` said so first.
        """
        in_flight = [False] * len(self._engines)
        is_complete = True
        for _ in range(min(learner.num_steps_left for learner in self._learners.values())):
            if is_stopping():
                is_complete = False
                break
            for engine in self._engines:
                if in_flight[engine]:
                    self._receive(engine)
                self._send(engine)
                in_flight[engine] = True
        for engine in self._engines:
            if in_flight[engine]:
                self._receive(engine)
        return is_complete

    def _send(self, engine: int) -> None:
        start = time.perf_counter()
        actions = {name: learner.act(engine) for name, learner in self._learners.items()}
        self._pool.send(engine, actions)
        sent = time.perf_counter()
        for learner in self._learners.values():
            learner.learn_meanwhile()
        self.times.act_s += sent - start
        self.times.learn_s += time.perf_counter() - sent

    def _receive(self, engine: int) -> None:
        start = time.perf_counter()
        batches = self._pool.receive(engine)
        received = time.perf_counter()
        for name, learner in self._learners.items():
            learner.record(engine, batches[name])
            self._trackers[name].record(self._rows[engine][name], batches[name])
        self.times.wait_s += received - start
        self.times.record_s += time.perf_counter() - received


def first_rows(batch: Batch, rows: slice) -> Batch:
    """Return a view of some slots of a batch that answers a reset, where nothing has ended."""
    return replace(
        batch,
        observation={name: array[rows] for name, array in batch.observation.items()},
        reward=batch.reward[rows],
        terminated=batch.terminated[rows],
        truncated=batch.truncated[rows],
        active=batch.active[rows],
        action_mask=None if batch.action_mask is None else batch.action_mask[rows],
    )
