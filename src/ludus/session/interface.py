"""What a connection to one engine can do, whatever the engine or bridge."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ludus.spec import Spec
from ludus.spec.batch import ActionBatch, Batches, StepTimes
from ludus.wire.requests import MetricSummary
from ludus.wire.reset import ResetRequest

__all__ = ["Session"]


class Session(Protocol):
    """One engine. Call :meth:`reset` first, then :meth:`send` and :meth:`receive` in turn."""

    @property
    def spec(self) -> Spec:
        """What the engine declared."""
        ...

    @property
    def times(self) -> StepTimes:
        """How the time of the last step was spent."""
        ...

    @property
    def pid(self) -> int | None:
        """Process id of the engine; None if it has no process that we started."""
        ...

    def reset(self, request: ResetRequest) -> Batches:
        """Begin new episodes; returns views that the next answer overwrites."""
        ...

    def send(self, actions: Mapping[str, ActionBatch]) -> None:
        """Send the actions of all policies and return at once."""
        ...

    def receive(self) -> Batches:
        """Wait for the answer to :meth:`send`; returns views that the next answer overwrites."""
        ...

    def hold(self, worlds: NDArray[np.bool_]) -> bool:
        """Let some worlds stand still in the next step: their actions are ignored, no time passes.

        Args:
            worlds: ``bool[num_worlds]``.

        Returns:
            Whether this session can; otherwise nothing has changed.
        """
        ...

    def call(self, target: Mapping[str, Any], method: str, arguments: Sequence[Any] = ()) -> Any:
        """Call a method of the game (PROTOCOL.md §8) and return its JSON value."""
        ...

    @property
    def has_requests(self) -> bool:
        """Whether requests of the game were waiting as of the last answer."""
        ...

    def take_requests(self) -> list[dict[str, Any]]:
        """Fetch the game's requests, oldest first (PROTOCOL.md §8)."""
        ...

    def take_metrics(self) -> dict[str, MetricSummary]:
        """Fetch the metrics that the game has reported (PROTOCOL.md §8), by name."""
        ...

    def show_status(self, status: Mapping[str, Any]) -> None:
        """Report the progress of training to the game (PROTOCOL.md §8), if it can show it."""
        ...

    def close(self) -> None:
        """End the session and the engine; may be called twice."""
        ...
