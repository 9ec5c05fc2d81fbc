"""Many engines as one batched environment: split send and receive, restarts, pinning."""

from __future__ import annotations

import contextlib
import logging
import secrets
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ludus.curriculum.world_parameters import Sums, WorldParameters
from ludus.engine import CorePlan, ReservedCores
from ludus.errors import (
    EngineCrashed,
    EngineError,
    EngineTimeout,
    ProtocolError,
    SequenceError,
    UsageError,
)
from ludus.pool.batches import copy_batch, copy_state, join_batches, truncate, who_acts
from ludus.session import Session
from ludus.settings.world_parameters import Parameter
from ludus.spec import PolicySpec, Spec, spec_difference
from ludus.spec.batch import ActionBatch, Batches, StepTimes
from ludus.wire.requests import MetricSummary, add_metrics
from ludus.wire.reset import Parameters, ResetAction, ResetRequest

__all__ = ["EnginePool"]

_log = logging.getLogger(__name__)
_RESTARTABLE = (EngineCrashed, EngineTimeout)


class EnginePool:
    """``num_engines`` equal engines as one batched environment; see :class:`ludus.pool.Pool`.

    An engine that dies or freezes is started again, up to ``max_restarts`` times in all. Its worlds
    are then reported as truncated, with what they observed last, and begin new episodes.

    Args:
        open_engine: Starts engine *k* and returns its session.
        num_engines: How many to start; all start at once.
        max_restarts: Restarts until an error is passed on.
        cores: Where the engines run, as long as other pools leave them there; freed when the pool
            is closed.

    Raises:
        EngineError: An engine did not start; the others are ended.
    """

    def __init__(
        self,
        open_engine: Callable[[int], Session],
        num_engines: int = 1,
        max_restarts: int = 0,
        cores: ReservedCores | None = None,
    ) -> None:
        self._open_engine = open_engine
        self._max_restarts = max_restarts
        self._num_restarts = 0
        self._cores = cores or ReservedCores(CorePlan((None,) * num_engines, None))
        self._sessions: list[Session] = []
        try:
            self._sessions = _open_all(open_engine, num_engines)
        except BaseException:
            self._cores.close()
            raise
        self._spec = self._sessions[0].spec
        for engine in range(num_engines):
            self._check_spec(engine)
        self.world_parameters: WorldParameters | None = None
        self._parameters: list[Mapping[str, Any] | None] = [None] * self.num_worlds
        self._policies = {policy.name: policy for policy in self._spec.policies}
        self._unmasked: set[str] = set()
        self._last: list[Batches | None] = [None] * num_engines
        self._is_lost = [False] * num_engines
        self._is_in_flight = [False] * num_engines
        self._seed = secrets.randbits(48)
        self._seeds = ResetRequest.all_worlds(self.num_worlds, self._seed).seeds

    @property
    def spec(self) -> Spec:
        """Spec of one engine; all engines have the same."""
        return self._spec

    @property
    def num_engines(self) -> int:
        """Number of engines."""
        return len(self._sessions)

    @property
    def policies(self) -> Mapping[str, PolicySpec]:
        """Policies by name, in wire order."""
        return self._policies

    @property
    def num_restarts(self) -> int:
        """Engines restarted so far."""
        return self._num_restarts

    @property
    def learner_cores(self) -> tuple[int, ...] | None:
        """Cores that pinned engines leave to Python; None where engines are not pinned."""
        return self._cores.plan.learner

    @property
    def sessions(self) -> Sequence[Session]:
        """The sessions, by engine."""
        return self._sessions

    def ignore_masks(self, policy: str) -> None:
        """Leave the action masks of ``policy`` out; see :meth:`ludus.pool.Pool.ignore_masks`."""
        self._policies[policy] = self._policies[policy].without_mask()
        self._unmasked.add(policy)

    def num_agents(self, policy: str) -> int:
        """Return the number of slots of ``policy`` over all engines."""
        return self._policies[policy].num_agents * self.num_engines

    def rows(self, policy: str, engine: int) -> slice:
        """Return the rows of ``engine`` in arrays over all engines."""
        size = self._policies[policy].num_agents
        return slice(engine * size, (engine + 1) * size)

    @property
    def num_worlds(self) -> int:
        """Number of worlds over all engines."""
        return self._spec.num_worlds * self.num_engines

    def reset(self, seed: int | None = None, parameters: Parameters = None) -> Batches:
        """Begin a new episode in every world; see :meth:`ludus.pool.Pool.reset`."""
        return self.reset_worlds(self.request_all(seed, parameters))

    def request_all(self, seed: int | None = None, parameters: Parameters = None) -> ResetRequest:
        """Return what :meth:`reset` asks for; a first one without a seed gets one here."""
        if seed is None and self._last[0] is None:
            seed = self._seed
        if seed is not None:
            self._seed = seed
        return ResetRequest.all_worlds(self.num_worlds, seed, parameters)

    def reset_worlds(self, request: ResetRequest) -> Batches:
        """Begin new episodes in some of the worlds of all engines; returns copies.

        Args:
            request: One seed and one action per world, counted over all engines. The first request
                begins all of them; worlds for which it has no seed get one here.
        """
        self._check_size(request)
        self._seeds = np.where(request.actions == ResetAction.SEED, request.seeds, self._seeds)
        if self._last[0] is None:
            all_seeded = np.full_like(request.actions, ResetAction.SEED)
            request = replace(request, seeds=self._seeds, actions=all_seeded)
        if self.world_parameters is not None:
            request = self.world_parameters.complete(request)
        self._remember_parameters(request)
        for engine in range(self.num_engines):
            self._keep_last(engine, self._reset_engine(engine, self._part(request, engine)))
            self._is_in_flight[engine] = False
        return self._joined()

    def latest(self) -> Batches:
        """Return copies of what the engines answered last, without asking them.

        Raises:
            SequenceError: ``reset`` was never called.
        """
        if self._last[0] is None:
            raise SequenceError("nothing to observe yet", hint="call reset() for all worlds first")
        return self._joined()

    def send(self, engine: int, actions: Mapping[str, ActionBatch]) -> None:
        """Send one engine the actions of its own slots and return at once."""
        if self._last[engine] is None:
            raise SequenceError("step before the first reset", hint="call reset() first")
        if self._is_in_flight[engine]:
            raise SequenceError(
                f"engine {engine} was sent actions twice", hint="receive its answer first"
            )
        if not self._is_lost[engine]:
            try:
                self._sessions[engine].send(actions)
            except _RESTARTABLE as error:
                self._note_loss(engine, error)
            if self._cores.look_again():
                self._cores.pin([session.pid for session in self._sessions])
        self._is_in_flight[engine] = True

    def receive(self, engine: int) -> Batches:
        """Wait for one engine's answer; views that its next ``receive`` overwrites."""
        if not self._is_in_flight[engine]:
            raise SequenceError("nothing to receive", hint="call send() first")
        # What comes may overwrite what was there, even if the engine dies on the way.
        before = who_acts(self._last[engine]) if self._max_restarts else {}
        self._is_in_flight[engine] = False
        if not self._is_lost[engine]:
            try:
                batches = self._visible(self._sessions[engine].receive())
                batches = self._draw_beginnings(engine, batches)
                self._keep_last(engine, batches)
                return batches
            except _RESTARTABLE as error:
                self._note_loss(engine, error)
        batches = {
            name: truncate(batch, *before[name]) for name, batch in self._revive(engine).items()
        }
        self._keep_last(engine, batches)
        return batches

    def step(
        self, actions: Mapping[str, ActionBatch], still: NDArray[np.bool_] | None = None
    ) -> Batches:
        """Step all engines; returns copies.

        Args:
            actions: Of all slots, by policy.
            still: ``bool[num_worlds]`` over all engines: worlds that take no part. They stand still
                where the session can let them; elsewhere they play a step that counts for nothing
                and then begin another episode, which takes a second message. None: all take part.
        """
        moving = [
            session
            for engine, session in enumerate(self._sessions)
            if still is not None and not session.hold(still[self._worlds(engine)])
        ]
        for engine in range(self.num_engines):
            own = {name: actions[name].rows(self.rows(name, engine)) for name in self._policies}
            self.send(engine, own)
        for engine in range(self.num_engines):
            self.receive(engine)
        batches = self._joined()
        if still is not None:
            for engine, session in enumerate(self._sessions):
                if session in moving:  # and not one that was started again meanwhile
                    self._begin_again(engine, still, batches)
            self._drop_outcomes(still, batches)
        return batches

    def call(
        self, target: Mapping[str, Any], method: str, arguments: Sequence[Any] = ()
    ) -> list[Any]:
        """Call a method of the game in every engine; returns one value per engine.

        Raises:
            EngineError: An engine died or froze; the next step or reset starts it again.
        """
        self._check_idle("call")
        values: list[Any] = []
        for engine, session in enumerate(self._sessions):
            if self._is_lost[engine]:
                hint = "a step or a reset starts it again"
                raise EngineCrashed(f"engine {engine} has died", hint)
            try:
                values.append(session.call(target, method, arguments))
            except _RESTARTABLE as error:
                self._note_loss(engine, error)
                raise
        return values

    def take_requests(self) -> list[dict[str, Any]]:
        """Fetch what the games ask of the trainer; see :meth:`ludus.pool.Pool.take_requests`."""
        self._check_idle("take_requests")
        taken: list[dict[str, Any]] = []
        for engine, session in enumerate(self._sessions):
            if self._is_lost[engine]:
                continue
            try:
                requests = session.take_requests()
            except _RESTARTABLE as error:
                self._note_loss(engine, error)
            else:
                taken += [request for request in requests if request not in taken]
        return taken

    def take_metrics(self) -> dict[str, MetricSummary]:
        """Fetch what the games have reported; see :meth:`ludus.pool.Pool.take_metrics`."""
        self._check_idle("take_metrics")
        taken: dict[str, MetricSummary] = {}
        for engine, session in enumerate(self._sessions):
            if self._is_lost[engine]:
                continue
            try:
                taken = add_metrics(taken, session.take_metrics())
            except _RESTARTABLE as error:
                self._note_loss(engine, error)
        return taken

    def randomise(self, parameters: Mapping[str, Parameter]) -> None:
        """Draw parameters for worlds; see :meth:`ludus.pool.Pool.randomise`."""
        self.world_parameters = WorldParameters(parameters, self._spec, self._seeds.tolist())

    def take_draws(self) -> Sums:
        """Return what was drawn for worlds; see :meth:`ludus.pool.Pool.take_draws`."""
        return {} if self.world_parameters is None else self.world_parameters.take_sums()

    def show_status(self, status: Mapping[str, Any]) -> None:
        """Tell the games how training goes; see :meth:`ludus.pool.Pool.show_status`."""
        self._check_idle("show_status")
        for engine, session in enumerate(self._sessions):
            if self._is_lost[engine]:
                continue
            try:
                session.show_status(status)
            except _RESTARTABLE as error:
                self._note_loss(engine, error)

    def times(self, engine: int) -> StepTimes:
        """Return where the time of that engine's last step went."""
        return self._sessions[engine].times

    def close(self) -> None:
        """End all engines; may be called twice."""
        with contextlib.ExitStack() as stack:
            stack.callback(self._cores.close)
            for session in self._sessions:
                stack.callback(session.close)

    def __enter__(self) -> EnginePool:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _begin_again(self, engine: int, still: NDArray[np.bool_], batches: Batches) -> None:
        """Begin new episodes in the worlds of an engine that should have stood still."""
        own = still[self._worlds(engine)]
        if not own.any() or self._is_lost[engine]:
            return
        actions = np.where(own, ResetAction.NEXT_EPISODE, ResetAction.LEAVE).astype(np.uint8)
        try:
            request = ResetRequest(np.zeros(len(own), "u8"), actions)
            fresh = self._visible(self._sessions[engine].reset(request))
        except _RESTARTABLE as error:
            # The next step finds the engine lost, and reports all of its episodes as truncated.
            self._note_loss(engine, error)
            return
        self._keep_last(engine, fresh)
        for name, policy in self._policies.items():
            rows = np.repeat(own, policy.agents_per_world)
            copy_state(fresh[name], batches[name], rows, self.rows(name, engine))

    def _keep_last(self, engine: int, batches: Batches) -> None:
        self._last[engine] = batches
        if self.world_parameters is not None:
            self.world_parameters.note(engine, batches)

    def _draw_beginnings(self, engine: int, batches: Batches) -> Batches:
        """Begin the episodes that begin in a step once more, with parameters drawn for them."""
        if self.world_parameters is None:
            return batches
        worlds = self._worlds(engine)
        begun = self.world_parameters.find_beginnings(engine, batches)
        request = self.world_parameters.request_beginnings(begun, worlds.start)
        if request is None:
            return batches
        self._remember_parameters(request, worlds.start)
        kept = {name: copy_batch(batch) for name, batch in batches.items()}
        try:
            fresh = self._visible(self._sessions[engine].reset(request))
        except _RESTARTABLE as error:
            # The next step finds the engine lost, and reports all of its episodes as truncated.
            self._note_loss(engine, error)
            return kept
        return {
            name: replace(
                kept[name],
                observation=batch.observation,
                active=batch.active,
                action_mask=batch.action_mask,
            )
            for name, batch in fresh.items()
        }

    def _drop_outcomes(self, still: NDArray[np.bool_], batches: Batches) -> None:
        for name, policy in self._policies.items():
            batch, rows = batches[name], np.repeat(still, policy.agents_per_world)
            batch.reward[rows] = 0.0
            batch.terminated[rows] = batch.truncated[rows] = False
            kept = ~rows[batch.final_index]
            batch.final_index = batch.final_index[kept]
            batch.final_observation = {
                entry: values[kept] for entry, values in batch.final_observation.items()
            }

    def _joined(self) -> Batches:
        parts = [batches for batches in self._last if batches is not None]
        return {
            name: join_batches([batches[name] for batches in parts], policy)
            for name, policy in self._policies.items()
        }

    def _note_loss(self, engine: int, error: EngineError) -> None:
        if self._num_restarts >= self._max_restarts:
            self.close()
            raise error
        self._num_restarts += 1
        self._is_lost[engine] = True
        _log.warning(
            "engine %d is started again (%d of %d): %s",
            engine,
            self._num_restarts,
            self._max_restarts,
            error,
        )

    def _check_idle(self, method: str) -> None:
        """Refuse to disturb a step: nothing may be lost of what some engines have told already."""
        if any(self._is_in_flight):
            engine = self._is_in_flight.index(True)
            raise SequenceError(
                f"{method} while engine {engine} is in a step", hint="receive its answer first"
            )

    def _part(self, request: ResetRequest, engine: int) -> ResetRequest:
        """Return what of a request is meant for one engine."""
        worlds = self._worlds(engine)
        parameters = request.parameters
        if parameters is not None and not isinstance(parameters, Mapping):
            parameters = parameters[worlds]
        return ResetRequest(request.seeds[worlds], request.actions[worlds], parameters)

    def _worlds(self, engine: int) -> slice:
        num = self._spec.num_worlds
        return slice(engine * num, (engine + 1) * num)

    def _check_size(self, request: ResetRequest) -> None:
        num, given = len(self._parameters), request.parameters
        if len(request.seeds) != num:
            raise UsageError(f"reset of {len(request.seeds)} worlds, the pool has {num}")
        if given is not None and not isinstance(given, Mapping) and len(given) != num:
            raise UsageError(f"parameters for {len(given)} worlds, the pool has {num}")

    def _remember_parameters(self, request: ResetRequest, first_world: int = 0) -> None:
        for i, action in enumerate(request.actions):
            given = request.parameters
            own = given if given is None or isinstance(given, Mapping) else given[i]
            if own is not None and action != ResetAction.LEAVE:
                self._parameters[first_world + i] = own

    def _reset_engine(self, engine: int, request: ResetRequest) -> Batches:
        if not self._is_lost[engine]:
            try:
                return self._visible(self._sessions[engine].reset(request))
            except _RESTARTABLE as error:
                self._note_loss(engine, error)
        return self._revive(engine, request)

    def _revive(self, engine: int, request: ResetRequest | None = None) -> Batches:
        """Start an engine again, as often as is allowed, and begin new episodes in it.

        Args:
            engine: Which one.
            request: Worlds that it seeds get these seeds, all others fresh ones.
        """
        while True:
            self._sessions[engine].close()
            try:
                self._sessions[engine] = self._open_engine(engine)
                self._check_spec(engine)
                revival = self._revival(engine, request)
                batches = self._visible(self._sessions[engine].reset(revival))
            except _RESTARTABLE as error:
                self._note_loss(engine, error)
            except BaseException:
                self.close()
                raise
            else:
                self._is_lost[engine] = False
                return batches

    def _revival(self, engine: int, request: ResetRequest | None) -> ResetRequest:
        worlds = self._worlds(engine)
        # Other seeds than before: the same episodes once more would teach nothing new.
        first = self._seed + 1_000_003 * self._num_restarts
        numbers = [(first + i) % (1 << 64) for i in range(worlds.start, worlds.stop)]
        seeds = np.array(numbers, np.uint64)
        if request is not None:
            seeds = np.where(request.actions == ResetAction.SEED, request.seeds, seeds)
        actions = np.full(len(seeds), ResetAction.SEED, np.uint8)
        return ResetRequest(seeds, actions, self._parameters[worlds])

    def _visible(self, batches: Batches) -> Batches:
        """Return batches without the masks that are to be ignored."""
        if not self._unmasked:
            return batches
        return {
            name: replace(batch, action_mask=None) if name in self._unmasked else batch
            for name, batch in batches.items()
        }

    def _check_spec(self, engine: int) -> None:
        if self._sessions[engine].spec != self._spec:
            difference = spec_difference(self._spec, self._sessions[engine].spec)
            self.close()
            raise ProtocolError(
                f"engine {engine} declares another game than engine 0 did at its start: "
                f"{difference}",
                hint="the scene must make the same agents whenever it is started",
            )


def _open_all(open_engine: Callable[[int], Session], num_engines: int) -> list[Session]:
    """Start all engines at once; on failure end those that did start."""
    with ThreadPoolExecutor(num_engines, "ludus-open") as executor:
        futures = [executor.submit(open_engine, engine) for engine in range(num_engines)]
    sessions = [future.result() for future in futures if future.exception() is None]
    failures = [error for future in futures if (error := future.exception())]
    if failures:
        for session in sessions:
            with contextlib.suppress(EngineError):
                session.close()
        raise failures[0]
    return sessions
