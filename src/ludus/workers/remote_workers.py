"""Collects experience on all machines: tells them what to play, and sorts what comes back."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any, cast

import numpy as np

from ludus.algorithms.learner import Learner
from ludus.algorithms.recorder import Recording, SharedLearner, Weights, pack_weights
from ludus.errors import ConfigError
from ludus.league.league import League
from ludus.league.policy_slot import PolicySlot
from ludus.networks.policy import Policy
from ludus.play.episodes import EpisodeTracker
from ludus.settings.policy_config import Mode
from ludus.workers.collect import IDLE_STEPS, CollectTimes, OnEpisodes
from ludus.workers.interface import LeagueOrder, MachineState, Order, PolicyOrder, Report
from ludus.workers.remote_pool import RemotePool

__all__ = ["RemoteWorkers"]

PLAY_MEMORY = 0.9
"""Weight of the past in the time that a machine takes."""


class RemoteWorkers:
    """Collects on all machines at once; a :class:`~ludus.workers.interface.Workers`.

    Learners learn what they owe while the machines play. Equal seeds give equal runs however the
    engines are spread: each engine has random streams of its own, and what machines report is put
    in the order in which one machine would have recorded it.

    Args:
        pool: The machines.
        learners: By policy.
        slots: By policy; they only say which mode it is in.
        trackers: By policy.
        league: None without self-play.

    Raises:
        ConfigError: A learner of a script cannot learn from other machines.
    """

    def __init__(
        self,
        pool: RemotePool,
        learners: Mapping[str, Learner],
        slots: Mapping[str, PolicySlot],
        trackers: Mapping[str, EpisodeTracker],
        league: League | None = None,
    ) -> None:
        self._pool = pool
        self._league = league
        self._league_sent: Any = None
        self._playing: dict[int, Mapping[str, set[int]]] = {}
        self._learners = {name: _shared(name, learner) for name, learner in learners.items()}
        self._slots = slots
        self._trackers = trackers
        self._modes: dict[str, Mode] = {}
        self._sent: dict[str, Weights] = {}
        self._play_s = [0.0] * len(pool.machines)
        self._updates = self._seed = 0
        self.times = CollectTimes()
        self.on_episodes: OnEpisodes | None = None

    @property
    def num_steps(self) -> int:
        """Agent steps so far, of all policies."""
        return sum(tracker.num_steps for tracker in self._trackers.values())

    @property
    def machines(self) -> list[MachineState]:
        """How the machines do."""
        pool = self._pool
        return [
            MachineState(machine.name, len(pool.engines(index)), self._play_s[index],
                         index in pool.lost)
            for index, machine in enumerate(pool.machines)
        ]  # fmt: skip

    def advance(self, updates: int) -> None:
        """Note how many updates the run has made."""
        self._updates = updates

    def playing(self, policy: str) -> set[int]:
        """Return the numbers of the past selves of ``policy`` that play somewhere."""
        return {number for of in self._playing.values() for number in of.get(policy, ())}

    def reset(self, seed: int) -> None:
        """Begin new episodes everywhere; drops what no learner has learnt from yet."""
        self._seed = seed
        for learner in self._learners.values():
            learner.forget()
        self._pool.ask("play", self._order(seed=seed))
        for index, report in self._pool.answers().items():
            self._note(index, report)

    def collect(self, is_stopping: Callable[[], bool]) -> bool:
        """Play until a learner is due to update; one call of every machine at a time."""
        while True:
            if is_stopping():
                return False
            self._collect_once()
            left = [slot.num_steps_left for slot in self._slots.values()]
            if 0 in left or all(steps is None for steps in left):
                return True

    def _collect_once(self) -> None:
        """Let all machines play once, and learn meanwhile."""
        for index in list(self._pool.lost):
            self._replace(index)
        start = time.perf_counter()
        learning = [self._learners[name] for name, of in self._slots.items() if of.mode == "train"]
        num_steps = min((learner.plan() for learner in learning), default=IDLE_STEPS)
        order = self._order(num_steps)
        self._pool.ask("play", order)
        sent = time.perf_counter()
        for learner in learning:
            learner.learn_meanwhile()
        learnt = time.perf_counter()
        reports = cast("dict[int, Report]", self._pool.answers())
        received = time.perf_counter()
        self._take(reports, num_steps)
        self.times.act_s += sent - start
        self.times.learn_s += learnt - sent
        self.times.wait_s += received - learnt
        self.times.record_s += time.perf_counter() - received

    def _order(
        self, num_steps: int = 0, seed: int | None = None, *, is_for_all: bool = True
    ) -> Order:
        policies: dict[str, PolicyOrder] = {}
        for name, slot in self._slots.items():
            learner = self._learners[name]
            if slot.mode == "train" and self._modes.get(name, "train") != "train":
                learner.forget()  # as its recorders do
            self._modes[name] = slot.mode
            acting = learner.recorder.policy if slot.mode == "train" else learner.policy
            policies[name] = PolicyOrder(
                slot.mode,
                learner.recorder.number,
                learner.recorder.is_exploring,
                self._new_weights(name, acting) if is_for_all else pack_weights(acting),
            )
        return Order(policies, self._updates, num_steps, seed, self._league_order(is_for_all))

    def _league_order(self, is_for_all: bool) -> LeagueOrder | None:
        """Return what self-play needs, None if the machines have it."""
        league = self._league
        if league is None:
            return None
        what = (league.learning, {name: list(of) for name, of in league.opponents.items()})
        if is_for_all and what == self._league_sent:
            return None
        if is_for_all:
            self._league_sent = what
        past = {
            name: {
                number: {key: value.cpu().numpy() for key, value in
                         league.tensors(name, number).items()}
                for number in numbers
            }
            for name, numbers in what[1].items()
        }  # fmt: skip
        return LeagueOrder(*what, past)

    def _new_weights(self, name: str, policy: Policy) -> Weights | None:
        """Return the weights of a policy, None if the machines have them."""
        weights = pack_weights(policy)
        if name in self._sent and np.array_equal(weights, self._sent[name]):
            return None
        self._sent[name] = weights
        return weights

    def _replace(self, index: int) -> None:
        """Start a worker again that was lost; it goes on in new episodes, with other seeds."""
        if not self._pool.restart(index):
            return
        seed = self._seed + 1_000_003 * self._pool.num_losses
        self._pool.machines[index].send("play", self._order(seed=seed, is_for_all=False))
        self._note(index, self._pool.machines[index].receive())

    def _note(self, index: int, report: Report) -> None:
        self._pool.note(report)
        self._playing[index] = report.playing

    def _take(self, reports: Mapping[int, Report], num_steps: int) -> None:
        """Hand what machines report to those whom it concerns."""
        lost = [self._pool.engines(index) for index in self._pool.lost]
        for name, learner in self._learners.items():
            self._trackers[name].num_steps += sum(of.num_steps[name] for of in reports.values())
            if self._slots[name].mode != "train":
                continue
            parts: dict[range, Recording] = {
                self._pool.engines(index): report.recordings[name]
                for index, report in reports.items()
            }
            learner.put(parts)
            for engines in lost:
                learner.lose(engines, num_steps)
        for index, report in reports.items():
            self._note(index, report)
            before = self._play_s[index] or report.play_s
            self._play_s[index] = PLAY_MEMORY * before + (1.0 - PLAY_MEMORY) * report.play_s
        restarts = sum(report.num_restarts for report in reports.values())
        self._pool.num_restarts = restarts + self._pool.num_losses
        self._rate(reports)
        self._tell_episodes(reports)

    def _rate(self, reports: Mapping[int, Report]) -> None:
        """Rate players by the matches that ended, in the order of steps and engines."""
        if self._league is None:
            return
        matches = [
            (step, self._pool.engines(index)[engine], match)
            for index, report in reports.items()
            for step, engine, match in report.matches
        ]
        self._league.rate(match for _, _, match in sorted(matches, key=lambda each: each[:2]))

    def _tell_episodes(self, reports: Mapping[int, Report]) -> None:
        """Count the episodes that ended, in the order of steps and engines."""
        ended = [
            (of.step, self._pool.engines(index)[of.engine], of)
            for index, report in reports.items()
            for of in report.ended
        ]
        for _, _, (_, _, policy, episodes) in sorted(ended, key=lambda each: each[:2]):
            tracker = self._trackers[policy]
            tracker.add(episodes)
            if self.on_episodes is not None:
                first = tracker.num_episodes - len(episodes.slots) + 1
                self.on_episodes(policy, first, episodes)


def _shared(name: str, learner: Learner) -> SharedLearner:
    if isinstance(learner, SharedLearner):
        return learner
    raise ConfigError(
        f"policy {name}: {type(learner).__name__} cannot learn from other machines",
        "PPO and SAC can; a learner of a script trains without a cluster",
    )
