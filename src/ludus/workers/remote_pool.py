"""The engines of all machines as one batched environment, and the machines that were lost.

Nothing here knows how a worker is reached; :class:`~ludus.workers.interface.Machine` does.
"""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from ludus.curriculum.world_parameters import Sums, add_sums
from ludus.errors import MachineLost, ProtocolError, SequenceError, UsageError
from ludus.pool.batches import join_batches
from ludus.settings.train_config import TrainConfig
from ludus.settings.world_parameters import Parameter
from ludus.spec import PolicySpec, Spec
from ludus.spec.batch import ActionBatch, Batches, StepTimes
from ludus.wire.requests import MetricSummary, add_metrics
from ludus.wire.reset import Parameters
from ludus.workers.interface import Machine, Report

__all__ = ["RemotePool"]

log = logging.getLogger(__name__)


class RemotePool:
    """The engines of all machines as one batched environment; see :class:`ludus.pool.Pool`.

    Every step is a call of every machine, which is what evaluations can afford. Training plays
    through :class:`~ludus.workers.remote_workers.RemoteWorkers`.

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
        with contextlib.ExitStack() as stack:
            for machine in self.machines:
                stack.callback(machine.close)

    def _joined(self, parts: Sequence[Batches]) -> Batches:
        for error in self.lost.values():
            raise error
        return {
            name: join_batches([batches[name] for batches in parts], policy)
            for name, policy in self._policies.items()
        }
