"""What training and the Gymnasium environments need from a source of experience."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

from ludus.curriculum.world_parameters import Sums
from ludus.settings.world_parameters import Parameter
from ludus.spec import PolicySpec, Spec
from ludus.spec.batch import ActionBatch, Batches, StepTimes
from ludus.wire.requests import MetricSummary

__all__ = ["Pool"]


class Pool(Protocol):
    """``num_engines`` equal engines as one batched environment.

    The slots of engine *k* are the rows ``rows(policy, k)`` of every array that spans all engines.
    Call :meth:`reset` first. Then either :meth:`step` all engines, or :meth:`send` to and
    :meth:`receive` from them one by one, so that the caller works on one while others simulate.
    """

    @property
    def spec(self) -> Spec:
        """Spec of one engine; all engines have the same."""
        ...

    @property
    def num_engines(self) -> int:
        """Number of engines."""
        ...

    @property
    def policies(self) -> Mapping[str, PolicySpec]:
        """Policies by name, in wire order; their ``num_agents`` is that of one engine."""
        ...

    def ignore_masks(self, policy: str) -> None:
        """Leave the action masks of ``policy`` out of its spec and of all batches from now on."""
        ...

    def num_agents(self, policy: str) -> int:
        """Return the number of slots of ``policy`` over all engines."""
        ...

    def rows(self, policy: str, engine: int) -> slice:
        """Return the rows of ``engine`` in arrays over all engines."""
        ...

    def reset(
        self,
        seed: int | None = None,
        parameters: Mapping[str, Any] | Sequence[Mapping[str, Any] | None] | None = None,
    ) -> Batches:
        """Begin a new episode in every world.

        Args:
            seed: World *i* (counted over all engines) gets ``seed + i``; None goes on with the
                worlds' random streams (at the first reset: a seed from the system).
            parameters: For every world, or one mapping or None per world.

        Returns:
            Batches over all engines, copies that stay valid.
        """
        ...

    def send(self, engine: int, actions: Mapping[str, ActionBatch]) -> None:
        """Send one engine the actions of its own slots and return at once."""
        ...

    def receive(self, engine: int) -> Batches:
        """Wait for one engine's answer.

        Returns:
            Batches of that engine's own slots: views that its next ``receive`` overwrites.

        Raises:
            SequenceError: Nothing was sent.
            EngineError: The engine failed and may not be restarted again.
        """
        ...

    def step(self, actions: Mapping[str, ActionBatch]) -> Batches:
        """Step all engines: ``send`` to each, then ``receive`` from each; copies."""
        ...

    def times(self, engine: int) -> StepTimes:
        """Return where the time of that engine's last step went."""
        ...

    def take_requests(self) -> list[dict[str, Any]]:
        """Fetch what the games ask of the trainer (PROTOCOL.md §8); cheap if there is nothing.

        Call it between two steps, when every ``send`` has had its ``receive``.

        Returns:
            Objects such as ``{"kind": "set_mode", "policy": "hero", "mode": "frozen"}``, engine by
            engine, oldest first; equal ones of several engines once. What is checked, and what
            is not: :func:`ludus.wire.requests.read_requests`.

        Raises:
            SequenceError: An answer was not received yet.
            EngineError: An engine failed and may not be restarted again.
        """
        ...

    def take_metrics(self) -> dict[str, MetricSummary]:
        """Fetch what the games have reported since the last time (PROTOCOL.md §8), by name.

        Call it between two steps, as :meth:`take_requests`. One round trip for each engine whose
        game can report metrics.

        Returns:
            The metrics of all engines together.

        Raises:
            SequenceError: An answer was not received yet.
            EngineError: An engine failed and may not be restarted again.
        """
        ...

    def show_status(self, status: Mapping[str, Any]) -> None:
        """Tell the games how training goes (PROTOCOL.md §8); one round trip for each engine.

        Call it between two steps, as :meth:`take_requests`, after every update; requests that a
        game makes in answer are there at once.

        Args:
            status: ``{"agent_steps": int, "updates": int, "policies": {name: {"mode": word,
                "mean_return": float or None}}}``; plain JSON, without NaN.

        Raises:
            UsageError: The status is not JSON.
            SequenceError: An answer was not received yet.
            EngineError: An engine failed and may not be restarted again.
        """
        ...

    def randomise(self, parameters: Mapping[str, Parameter]) -> None:
        """Draw parameters for worlds whose episodes begin; call :meth:`reset` next.

        The draws of a world follow from the seed that it gets in that reset; without one, from
        the seed that it got last.

        Args:
            parameters: By name: a value, or how it is drawn.
        """
        ...

    def take_draws(self) -> Sums:
        """Return count and sum of each number that was drawn for worlds since the last time."""
        ...

    @property
    def num_restarts(self) -> int:
        """Engines restarted so far, after a crash or a missed deadline."""
        ...

    def close(self) -> None:
        """End all engines; may be called twice."""
        ...
