"""A conversation with a game that speaks another bridge's wire, as any other session."""

from __future__ import annotations

import inspect
import time
from collections.abc import Mapping, Sequence
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ludus.errors import GameError, SequenceError, UsageError
from ludus.legacy.game import LegacyGame
from ludus.legacy.world import LegacyWorld, num_agents_of, read_declarations
from ludus.spec import PolicySpec, Spec
from ludus.spec.batch import ActionBatch, Batches, StepTimes
from ludus.spec.finite import check_finite
from ludus.wire.requests import MetricSummary
from ludus.wire.reset import ResetAction, ResetRequest

__all__ = ["LegacySession"]


class LegacySession:
    """One game as a :class:`~ludus.session.Session`: one world with the policies it declares.

    Where agents do not restart by themselves, the episode of a world ends when those of all its
    agents have; the next one begins in the same step. A game that fails is closed.

    Args:
        game: Closed with the session, and also if the session cannot be made.
        max_episode_steps: Steps after which an episode is truncated; None: the game decides.

    Raises:
        TargetError: A space cannot be trained.
        ConfigError: There are no agents.
    """

    def __init__(self, game: LegacyGame, max_episode_steps: int | None = None) -> None:
        self._game = game
        try:
            self._spec = read_declarations(game.declarations, max_episode_steps)
            self._num_agents = num_agents_of(game.declarations)
            declared = zip(self._spec.policies, game.declarations, strict=True)
            self._worlds = [LegacyWorld(*pair, self._num_agents) for pair in declared]
        except BaseException:
            game.close()
            raise
        self._policies: dict[str, PolicySpec] = {part.name: part for part in self._spec.policies}
        self._batches: Batches = {
            name: world.batch for name, world in zip(self._policies, self._worlds, strict=True)
        }
        self._has_reset = self._is_in_flight = False
        self._num_steps = self._num_steps_in_all = 0
        self._close_on_error = _CloseOnError(game)
        self._sent_ns = self._answered_ns = time.perf_counter_ns()
        self._wait_ns = 0
        self._times = StepTimes(0, 0, 0, 0)

    @property
    def spec(self) -> Spec:
        """What the user or the game has declared."""
        return self._spec

    @property
    def pid(self) -> int | None:
        """Process id of the game; None if it is not ours."""
        return self._game.pid

    @property
    def times(self) -> StepTimes:
        """Where the time of the last step went, measured here.

        ``tick`` counts steps; ``engine_us`` is from sending to the answer, with that to the reset
        at the end of an episode; ``bridge_us`` is what this session took to make batches of it.
        """
        return self._times

    def reset(self, request: ResetRequest) -> Batches:
        """Begin a new episode; see :meth:`ludus.session.Session.reset`.

        Raises:
            UsageError: It is a request for several worlds, or its parameters do not fit.
            SequenceError: A step is under way, or the session is closed.
            EngineError: The game failed.
        """
        if len(request.seeds) != 1:
            raise UsageError(f"reset of {len(request.seeds)} worlds, the game has 1")
        self._check_turn("reset")
        action, given = ResetAction(int(request.actions[0])), _parameters(request)
        if action is ResetAction.LEAVE and not self._has_reset:
            raise SequenceError("the first reset left the world out")
        with self._close_on_error:
            for world in self._worlds:
                world.clear_outcome()
            if action is not ResetAction.LEAVE:
                self._begin(int(request.seeds[0]) if action is ResetAction.SEED else None, given)
            check_finite(self._policies, self._batches, 0)
        self._has_reset = True
        self._num_steps = 0
        self._answered_ns = time.perf_counter_ns()
        return self._batches

    def send(self, actions: Mapping[str, ActionBatch]) -> None:
        """Send the actions and return at once.

        Raises:
            SequenceError: ``reset`` was never called, or the last answer was not received.
            ActionError: The policy is missing, or its arrays have the wrong shape.
            EngineError: The game has gone.
        """
        self._check_turn("step")
        if not self._has_reset:
            raise SequenceError("step before the first reset", hint="call reset() first")
        own: list[Any] = [None] * self._num_agents
        for world in self._worlds:
            world.write_actions(actions, own)
        self._sent_ns = time.perf_counter_ns()
        self._wait_ns = self._sent_ns - self._answered_ns
        with self._close_on_error:
            self._game.send(own)
        self._is_in_flight = True

    def receive(self) -> Batches:
        """Wait for the answer to ``send``; returns views that the next answer overwrites.

        Raises:
            SequenceError: Nothing was sent.
            GameError: The game reported a mistake, or sent NaN or infinity.
            EngineError: The game died, froze or broke its wire.
        """
        if not self._is_in_flight:
            raise SequenceError("nothing to receive", hint="call reset() or send() first")
        self._is_in_flight = False
        for world in self._worlds:  # costs nothing while the game plays
            world.clear_outcome()
        with self._close_on_error:
            outcome = self._game.receive()
            answered_ns = time.perf_counter_ns()
            engine_ns = answered_ns - self._sent_ns
            self._num_steps += 1
            have_ended = [world.take(outcome) for world in self._worlds]
            reset_ns = self._begin(None, None) if all(have_ended) else 0
            check_finite(self._policies, self._batches, self._num_steps)
        self._answered_ns = time.perf_counter_ns()
        bridge_ns = self._answered_ns - answered_ns - reset_ns
        parts = (engine_ns + reset_ns, bridge_ns, self._wait_ns)
        self._num_steps_in_all += 1
        self._times = StepTimes(self._num_steps_in_all, *(part // 1000 for part in parts))
        return self._batches

    def hold(self, worlds: NDArray[np.bool_]) -> bool:
        """False: a step is one of the only world."""
        return False

    def call(self, target: Mapping[str, Any], method: str, arguments: Sequence[Any] = ()) -> Any:
        """Call a method that the bridge offers, on ``{"world": 0}``; return its value.

        Raises:
            SequenceError: A step is under way, or the session is closed.
            UsageError: The arguments do not fit the method.
            GameError: There is no such method, or no such thing to call it of.
            EngineError: The game failed.
        """
        self._check_turn("call")
        found = self._game.methods.get(method)
        if dict(target) != {"world": 0} or found is None:
            known = ", ".join(self._game.methods) or "none"
            raise GameError(
                f"call of {method} failed: {dict(target)} has no such method",
                hint=f'of a game of this bridge only {{"world": 0}} has methods: {known}',
            )
        try:
            inspect.signature(found).bind(*arguments)
        except TypeError as error:
            raise UsageError(f"the arguments of {method} do not fit: {error}") from error
        with self._close_on_error:
            return found(*arguments)

    @property
    def has_requests(self) -> bool:
        """False: these games ask nothing of their trainer."""
        return False

    def take_requests(self) -> list[dict[str, Any]]:
        """Return nothing: these games ask nothing of their trainer."""
        return []

    def take_metrics(self) -> dict[str, MetricSummary]:
        """Return nothing: these games report no metrics."""
        return {}

    def show_status(self, status: Mapping[str, Any]) -> None:
        """Do nothing: these games do not watch their training."""

    def close(self) -> None:
        """End the conversation, and the game if it is ours; may be called twice."""
        self._close_on_error.close()

    def _begin(self, seed: int | None, parameters: Mapping[str, Any] | None) -> int:
        """Begin an episode; return how long the game took, nanoseconds."""
        began_ns = time.perf_counter_ns()
        observations = self._game.reset(seed, parameters)
        taken_ns = time.perf_counter_ns() - began_ns
        for world in self._worlds:
            world.begin(observations)
        return taken_ns

    def _check_turn(self, what: str) -> None:
        if self._close_on_error.is_closed:
            raise SequenceError(
                f"{what} after the end of the session", hint="make a new environment"
            )
        if self._is_in_flight:
            raise SequenceError(f"{what} during a step", hint="receive its answer first")


class _CloseOnError:
    """Closes the game on an error, since the two sides may be out of step then.

    It does not know its session, which is collected as soon as nobody holds it.
    """

    def __init__(self, game: LegacyGame) -> None:
        self._game = game
        self.is_closed = False

    def close(self) -> None:
        self.is_closed = True
        self._game.close()

    def __enter__(self) -> None:
        pass

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if error is not None and not isinstance(error, UsageError):
            self.close()


def _parameters(request: ResetRequest) -> Mapping[str, Any] | None:
    given = request.parameters
    if given is None or isinstance(given, Mapping):
        return given
    if len(given) != 1:
        raise UsageError(f"parameters for {len(given)} worlds, there is 1")
    return given[0]
