"""The engines of all machines, for a trainer: as a pool, and as what collects experience.

Nothing here knows how a worker is reached; :class:`~ludus.workers.interface.Machine` does.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, cast

import numpy as np

from ludus.algorithms.learner import Learner
from ludus.algorithms.recorder import Recording, SharedLearner, Weights, pack_weights
from ludus.curriculum.world_parameters import Sums, add_sums
from ludus.errors import ConfigError, MachineLost, ProtocolError, SequenceError, UsageError
from ludus.league.league import League
from ludus.league.policy_slot import PolicySlot
from ludus.networks.policy import Policy
from ludus.play.episodes import EpisodeTracker
from ludus.pool.engine_pool import join_batches
from ludus.settings.policy_config import Mode
from ludus.settings.train_config import TrainConfig
from ludus.settings.world_parameters import Parameter
from ludus.spec import PolicySpec, Spec
from ludus.spec.batch import ActionBatch, Batches, StepTimes
from ludus.wire.requests import MetricSummary, add_metrics
from ludus.wire.reset import Parameters
from ludus.workers.collect import IDLE_STEPS, CollectTimes, OnEpisodes
from ludus.workers.interface import LeagueOrder, Machine, MachineState, Order, PolicyOrder, Report

__all__ = ["RemotePool", "RemoteWorkers"]

PLAY_MEMORY = 0.9
"""Weight of the past in the time that a machine takes."""

log = logging.getLogger(__name__)


class RemotePool:
    """The engines of all machines as one batched environment; see :class:`ludus.pool.Pool`.

    Every step is a call of every machine, which is what evaluations can afford. Training plays
    through :class:`RemoteWorkers`.

    Args:
        machines: One for each worker, whose engines have started; closed with the pool.
        specs: Of their engines.
        start: Starts the worker of a machine once more; returns None while it has no place.
        config: Settings of the run.

    Attributes:
        machines: One for each worker.
        lost: Machines that are to be started again, and how they were lost.
        num_losses: How often a machine was lost.
        num_restarts: Engines restarted so far, and workers.

    Raises:
        ProtocolError: The games of two machines declare different agents.
    """

    def __init__(
        self,
        machines: Sequence[Machine],
        specs: Sequence[Spec],
        start: Callable[[int], Machine | None],
        config: TrainConfig,
    ) -> None:
        self.machines = list(machines)
        self.lost: dict[int, MachineLost] = {}
        self.num_restarts = 0
        self._start = start
        self._config = config
        self.num_losses = 0
        self._waiting: set[int] = set()
        self._draws: Sums = {}
        self._metrics: dict[str, MetricSummary] = {}
        self._status: Mapping[str, Any] | None = None
        self._parameters: Mapping[str, Parameter] = {}
        self._unmasked: list[str] = []
        self._spec = specs[0]
        self._num_engines = config.num_engines
        self._policies = {policy.name: policy for policy in self._spec.policies}
        for machine, spec in zip(machines, specs, strict=True):
            self._check_spec(machine, spec)

    def _check_spec(self, machine: Machine, spec: Spec) -> None:
        if spec != self._spec:
            raise ProtocolError(
                f"the game of {machine.name} declares other worlds or agents than that of "
                f"{self.machines[0].name}",
                "the game must be the same everywhere, and make the same agents whenever it is "
                "started",
            )

    @property
    def spec(self) -> Spec:
        """Spec of one engine; all engines have the same."""
        return self._spec

    @property
    def num_engines(self) -> int:
        """Number of engines of all machines."""
        return self._num_engines * len(self.machines)

    @property
    def policies(self) -> Mapping[str, PolicySpec]:
        """Policies by name, in wire order."""
        return self._policies

    @property
    def num_worlds(self) -> int:
        """Number of worlds over all engines."""
        return self._spec.num_worlds * self.num_engines

    def ignore_masks(self, policy: str) -> None:
        """Leave the action masks of ``policy`` out; see :meth:`ludus.pool.Pool.ignore_masks`."""
        self._policies[policy] = self._policies[policy].without_mask()
        self._unmasked.append(policy)
        self.call_all("ignore_masks", policy)

    def engines(self, machine: int) -> range:
        """Return the engines of a machine."""
        return range(machine * self._num_engines, (machine + 1) * self._num_engines)

    def num_agents(self, policy: str) -> int:
        """Return the number of slots of ``policy`` over all engines."""
        return self._policies[policy].num_agents * self.num_engines

    def rows(self, policy: str, engine: int) -> slice:
        """Return the rows of ``engine`` in arrays over all engines."""
        size = self._policies[policy].num_agents
        return slice(engine * size, (engine + 1) * size)

    def ask(self, method: str, *arguments: Any) -> None:
        """Call a method of every worker with equal arguments and return at once."""
        for index in range(len(self.machines)):
            self._ask_one(index, method, *arguments)

    def _ask_one(self, index: int, method: str, *arguments: Any) -> None:
        if index not in self.lost:
            try:
                self.machines[index].send(method, *arguments)
            except MachineLost as error:
                self.lost[index] = error

    def answers(self) -> dict[int, Any]:
        """Return what each worker returned, by machine; those that are lost are left out."""
        found: dict[int, Any] = {}
        for index, machine in enumerate(self.machines):
            if index not in self.lost:
                try:
                    found[index] = machine.receive()
                except MachineLost as error:
                    self.lost[index] = error
        return found

    def call_all(self, method: str, *arguments: Any) -> list[Any]:
        """Call a method of every worker with equal arguments; return what they returned."""
        self.ask(method, *arguments)
        return list(self.answers().values())

    def prepare(self, config: TrainConfig) -> None:
        """Let all workers make what acts and records; ``config`` has settings of every policy."""
        self._config = config
        self.call_all("prepare", config)

    def restart(self, index: int) -> bool:
        """Start the worker of a machine that was lost once more.

        Returns:
            Whether it has a place; without one, the others go on, and it is worth another try.

        Raises:
            MachineLost: That was done ``max_restarts`` times already, or does not help.
        """
        error, limit = self.lost[index], self._config.max_restarts
        is_new = index not in self._waiting
        if is_new:
            if self.num_losses >= limit:
                raise error
            self.num_losses += 1
            log.warning("%s; starting it again (%d of %d)", error.message, self.num_losses, limit)
        machine = self._start(index)
        if machine is None:
            self._waiting.add(index)
            if len(self._waiting) == len(self.machines):
                raise error
            if is_new:
                log.warning("there is no node for machine %d; the others go on until one joins",
                            index)  # fmt: skip
            return False
        self._waiting.discard(index)
        self.machines[index] = machine
        self._check_spec(machine, machine.receive())
        calls: list[tuple[str, Any]] = [("ignore_masks", policy) for policy in self._unmasked]
        calls.append(("prepare", self._config))
        if self._parameters:
            calls.append(("randomise", self._parameters))
        for method, argument in calls:
            machine.send(method, argument)
            machine.receive()
        del self.lost[index]
        return True

    def reset(self, seed: int | None = None, parameters: Parameters = None) -> Batches:
        """Begin a new episode in every world; see :meth:`ludus.pool.Pool.reset`."""
        if parameters is not None:
            raise UsageError("worlds on other machines take no parameters")
        return self._joined(self.call_all("reset_pool", seed))

    def step(self, actions: Mapping[str, ActionBatch]) -> Batches:
        """Step all engines; returns copies."""
        for index in range(len(self.machines)):
            engines = self.engines(index)
            own = {
                name: batch.rows(slice(
                    self.rows(name, engines[0]).start, self.rows(name, engines[-1]).stop
                ))
                for name, batch in actions.items()
            }  # fmt: skip
            self._ask_one(index, "step", own)
        return self._joined(list(self.answers().values()))

    def send(self, engine: int, actions: Mapping[str, ActionBatch]) -> None:
        """Refuse: engines of other machines are stepped together."""
        raise SequenceError("engines on other machines cannot be stepped one by one", "use step")

    def receive(self, engine: int) -> Batches:
        """Refuse: engines of other machines are stepped together."""
        raise SequenceError("engines on other machines cannot be stepped one by one", "use step")

    def times(self, engine: int) -> StepTimes:
        """Return zeros: workers keep their times to themselves."""
        return StepTimes(0, 0, 0, 0)

    def randomise(self, parameters: Mapping[str, Parameter]) -> None:
        """Draw parameters for worlds; see :meth:`ludus.pool.Pool.randomise`."""
        self._parameters = parameters
        self.call_all("randomise", parameters)

    def take_draws(self) -> Sums:
        """Return what was drawn for worlds; see :meth:`ludus.pool.Pool.take_draws`."""
        taken, self._draws = self._draws, {}
        return taken

    def take_requests(self) -> list[dict[str, Any]]:
        """Fetch what the games ask of the trainer; see :meth:`ludus.pool.Pool.take_requests`."""
        taken: list[dict[str, Any]] = []
        for requests in self.call_all("tell", self._status):
            taken += [request for request in requests if request not in taken]
        self._status = None
        return taken

    def take_metrics(self) -> dict[str, MetricSummary]:
        """Fetch what the games have reported; see :meth:`ludus.pool.Pool.take_metrics`."""
        taken, self._metrics = self._metrics, {}
        return taken

    def note(self, report: Report) -> None:
        """Keep what a worker reports beside its recordings, until it is taken."""
        self._metrics = add_metrics(self._metrics, report.metrics)
        self._draws = add_sums(self._draws, report.draws)

    def show_status(self, status: Mapping[str, Any]) -> None:
        """Tell the games how training goes, together with the next :meth:`take_requests`."""
        self._status = status

    def close(self) -> None:
        """End all workers and their engines; may be called twice."""
        for machine in self.machines:
            machine.close()

    def _joined(self, parts: Sequence[Batches]) -> Batches:
        for error in self.lost.values():
            raise error
        return {
            name: join_batches([batches[name] for batches in parts], policy)
            for name, policy in self._policies.items()
        }


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
        if self._league is not None:
            matches = [
                (step, self._pool.engines(index)[engine], match)
                for index, report in reports.items()
                for step, engine, match in report.matches
            ]
            in_order = sorted(matches, key=lambda each: each[:2])
            self._league.rate(match for _, _, match in in_order)
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
