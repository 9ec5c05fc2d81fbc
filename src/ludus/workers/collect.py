"""Collecting experience: engines simulate while the learners work for another engine."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from ludus.errors import DivergenceError
from ludus.league.policy_slot import PolicySlot
from ludus.league.seats import Match, Seats
from ludus.play.episodes import EndedEpisodes, EpisodeTracker
from ludus.pool.interface import Pool
from ludus.spec.batch import Batch

__all__ = ["IDLE_STEPS", "CollectTimes", "Collector", "OnEpisodes", "OnMatches"]

IDLE_STEPS = 32
"""Steps between two moments of decision while no policy learns."""

OnEpisodes = Callable[[str, int, EndedEpisodes], None]
"""Gets a policy, the number of the first of some episodes, from 1, and the episodes."""

OnMatches = Callable[[list[Match]], None]


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
    """Steps all engines of a pool, with one policy slot for each policy.

    Engines take turns in a fixed order, so that equal seeds give equal runs: receive from one,
    choose its next actions, send them, go on to the next. While actions are chosen for one engine
    all the others simulate; while all simulate, learners that can do so learn.

    Args:
        pool: The engines.
        slots: Policy slots by policy.
        trackers: By policy.
        seats: The same that the policy slots have; None without self-play.

    Attributes:
        times: Where the time went.
        place: Step, since the call of :meth:`collect`, and engine of the last answer.
        on_episodes: Gets the episodes that end, while engines are in a step.
        on_matches: Gets the games of self-play that end, while engines are in a step.
    """

    def __init__(
        self,
        pool: Pool,
        slots: Mapping[str, PolicySlot],
        trackers: Mapping[str, EpisodeTracker],
        seats: Seats | None = None,
    ) -> None:
        self._pool = pool
        self._slots = slots
        self._trackers = trackers
        self._seats = seats
        self._engines = range(pool.num_engines)
        self._rows = [{name: pool.rows(name, k) for name in slots} for k in self._engines]
        self.times = CollectTimes()
        self.place = (0, 0)
        self.on_episodes: OnEpisodes | None = None
        self.on_matches: OnMatches | None = None

    @property
    def num_steps(self) -> int:
        """Agent steps so far, of all policies."""
        return sum(tracker.num_steps for tracker in self._trackers.values())

    @property
    def machines(self) -> tuple[()]:
        """None: this process plays itself."""
        return ()

    def advance(self, updates: int) -> None:
        """Note how many updates the run has made; after each, and before a reset."""
        for slot in self._slots.values():
            slot.advance(updates)
        if self._seats is not None:
            self._seats.advance(updates)

    def playing(self, policy: str) -> set[int]:
        """Return the numbers of the past selves of ``policy`` that play somewhere."""
        return set() if self._seats is None else self._seats.playing(policy)

    def reset(self, seed: int) -> None:
        """Begin new episodes everywhere; drops what no learner has learnt from yet."""
        batches = self._pool.reset(seed)
        for engine in self._engines:
            rows = self._rows[engine]
            firsts = {name: first_rows(batches[name], rows[name]) for name in self._slots}
            if self._seats is not None:
                self._seats.begin(engine, firsts)
            for name, slot in self._slots.items():
                own = slot.begin(engine, firsts[name])
                self._trackers[name].begin(rows[name], own)

    def collect(self, is_stopping: Callable[[], bool]) -> bool:
        """Step until a learner is due to update.

        Args:
            is_stopping: Asked before each step.

        Returns:
            Whether that was reached; False if ``is_stopping`` said so first.
        """
        in_flight = [False] * len(self._engines)
        is_complete, last = True, 0
        for step in range(self._num_steps_left()):
            if is_stopping():
                is_complete = False
                break
            for engine in self._engines:
                if in_flight[engine]:
                    self._receive(engine, step - 1)
                in_flight[engine] = True
                try:
                    self._send(engine)
                except DivergenceError:  # of a gradient step; who owns the pool goes on with it
                    for each in self._engines:
                        if in_flight[each]:
                            self._pool.receive(each)
                    raise
            last = step
        for engine in self._engines:
            if in_flight[engine]:
                self._receive(engine, last)
        return is_complete

    def _num_steps_left(self) -> int:
        left = (slot.num_steps_left for slot in self._slots.values())
        return min((steps for steps in left if steps is not None), default=IDLE_STEPS)

    def _send(self, engine: int) -> None:
        start = time.perf_counter()
        actions = {name: slot.act(engine) for name, slot in self._slots.items()}
        self._pool.send(engine, actions)
        sent = time.perf_counter()
        for slot in self._slots.values():
            slot.learn_while_stepping()
        self.times.act_s += sent - start
        self.times.learn_s += time.perf_counter() - sent

    def _receive(self, engine: int, step: int) -> None:
        start = time.perf_counter()
        self.place = (step, engine)
        batches = self._pool.receive(engine)
        received = time.perf_counter()
        if self._seats is not None:
            matches = self._seats.record(engine, batches)
            if matches and self.on_matches is not None:
                self.on_matches(matches)
        for name, slot in self._slots.items():
            own = slot.record(engine, batches[name])
            tracker = self._trackers[name]
            ended = tracker.record(self._rows[engine][name], own)
            if self.on_episodes is not None and len(ended.slots):
                self.on_episodes(name, tracker.num_episodes - len(ended.slots) + 1, ended)
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
