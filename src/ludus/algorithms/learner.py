"""The seam between collecting experience and learning from it.

The collector knows :class:`Learner` only, so algorithms that learn from rollouts and algorithms
that learn from a replay buffer look the same to it, and each policy of a run may have its own.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

from torch import Tensor

from ludus.algorithms.imitation import Imitation
from ludus.errors import DivergenceError
from ludus.networks.policy import Policy
from ludus.spec.batch import ActionBatch, Batch

__all__ = ["NUM_SAMPLES", "Learner", "LearnerSettings", "LearnerState", "check_finite_losses"]

NUM_SAMPLES = 64
"""Recent observations that a state carries, for the parity test of exported policies."""


@dataclass(frozen=True)
class LearnerSettings:
    """What a learner is told about the run it is part of.

    Attributes:
        engine_rows: Slots of each engine.
        seed: Of its random streams.
        is_mixed: Whether updates are computed in bfloat16 where that is safe.
        is_compiled: Whether they are compiled.
        first_engine: Number of the first engine among those of all machines.
        imitation: Demonstrations to learn from beside the rewards; None without.
    """

    engine_rows: list[slice]
    seed: int
    is_mixed: bool = False
    is_compiled: bool = False
    first_engine: int = 0
    imitation: Imitation | None = None


@dataclass(frozen=True)
class LearnerState:
    """All that a learner needs to go on later.

    Attributes:
        tensors: By dotted name; saved as safetensors. ``policy.*`` is the policy, ``samples.*``
            some of the last observations by entry.
        values: JSON values.
        replay: Tensors by name that only the newest checkpoint needs.
    """

    tensors: dict[str, Tensor]
    values: dict[str, Any]
    replay: dict[str, Tensor] = field(default_factory=dict[str, Tensor])


@runtime_checkable
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

    def learn_while_stepping(self) -> None:
        """Learn a little while engines simulate; called after actions were sent to an engine."""
        ...

    def update(self, progress: float) -> dict[str, float]:
        """Learn from what was recorded.

        Args:
            progress: Share of the run that is over, 0 to 1, for schedules.

        Returns:
            Metrics by name, see :mod:`ludus.runs.metrics`.

        Raises:
            DivergenceError: A loss became NaN or infinite.
        """
        ...

    def state(self) -> LearnerState:
        """Return copies of all that a later run needs to go on.

        Raises:
            DivergenceError: A loss since the last update was NaN or infinite; told once.
        """
        ...

    def load_state(self, state: LearnerState) -> None:
        """Go on from ``state``; call :meth:`begin` next.

        Raises:
            CheckpointError: It does not fit this policy.
        """
        ...


def check_finite_losses(policy: str, metrics: Mapping[str, float]) -> None:
    """Check that no metric of an update is NaN or infinite.

    Raises:
        DivergenceError: A metric is NaN or infinite.
    """
    wrong = [f"{name} is {value}" for name, value in metrics.items() if not math.isfinite(value)]
    if wrong:
        raise DivergenceError(
            f"policy {policy}: {', '.join(wrong)}",
            "look for huge rewards or observations (ludus check reports them), "
            "or lower learning_rate",
        )
