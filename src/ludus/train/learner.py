"""The seam between collecting experience and learning from it.

The collector knows :class:`Learner` only, so algorithms that learn from rollouts and algorithms
that learn from a replay buffer look the same to it, and each policy of a run may have its own.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

from torch import Tensor

from ludus.batch import ActionBatch, Batch
from ludus.train.policy import Policy

__all__ = ["Learner", "LearnerState"]


@dataclass(frozen=True)
class LearnerState:
    """All that a learner needs to go on later.

    Attributes:
        tensors: By dotted name; saved as safetensors.
        values: JSON values.
    """

    tensors: dict[str, Tensor]
    values: dict[str, Any]


class Learner(Protocol):
    """Trains one policy.

    Per engine the order is :meth:`begin` once after a reset, then :meth:`act` and :meth:`record`
    in turn. Once :attr:`num_steps_left` is 0 call :meth:`update` before the next :meth:`act`.
    """

    @property
    def policy(self) -> Policy:
        """What is being trained."""
        ...

    @property
    def num_steps_left(self) -> int:
        """Steps of every engine until the next update."""
        ...

    def begin(self, engine: int, batch: Batch) -> None:
        """Take the first observations of an engine that was reset; drops unfinished rollouts."""
        ...

    def act(self, engine: int) -> ActionBatch:
        """Return the actions for the observations of the last ``begin`` or ``record``.

        Returns:
            Views that the next rollout overwrites.
        """
        ...

    def record(self, engine: int, batch: Batch) -> None:
        """Take the outcome of the last actions, and the observations to act on next."""
        ...

    def update(self, progress: float) -> dict[str, float]:
        """Learn from what was recorded.

        Args:
            progress: Share of the run that is over, 0 to 1, for schedules.

        Returns:
            Metrics by name, see :mod:`ludus.train.metrics`.

        Raises:
            DivergenceError: A loss became NaN or infinite.
        """
        ...

    def state(self) -> LearnerState:
        """Return copies of all that a later run needs to go on."""
        ...

    def load_state(self, state: LearnerState) -> None:
        """Go on from ``state``; call :meth:`begin` next.

        Raises:
            CheckpointError: It does not fit this policy.
        """
        ...
