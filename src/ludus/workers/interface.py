"""What a trainer needs from whoever plays, and what a worker needs from its trainer.

A worker plays all engines of one machine. It gets one call for each rollout: an :class:`Order` with
the weights of the policies that changed; its answer is a :class:`Report`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

from ludus.algorithms.recorder import Recording, Weights
from ludus.play.episodes import EndedEpisodes
from ludus.settings.policy_config import Mode
from ludus.workers.collect import CollectTimes, OnEpisodes

__all__ = ["Ended", "Machine", "Order", "PolicyOrder", "Report", "Workers"]


class Workers(Protocol):
    """Plays all engines of a run.

    Attributes:
        times: Where the time went.
        on_episodes: Gets the episodes that end.
    """

    times: CollectTimes
    on_episodes: OnEpisodes | None

    @property
    def num_steps(self) -> int:
        """Agent steps so far, of all policies."""
        ...

    def advance(self, updates: int) -> None:
        """Note how many updates the run has made; after each, and before a reset."""
        ...

    def reset(self, seed: int) -> None:
        """Begin new episodes everywhere; drops what no learner has learnt from yet."""
        ...

    def collect(self, is_stopping: Callable[[], bool]) -> bool:
        """Play until a learner is due to update; return whether that was reached.

        Args:
            is_stopping: Asked before each step, or before each rollout of other machines.
        """
        ...


@dataclass(frozen=True)
class PolicyOrder:
    """How a worker goes on with one policy.

    Attributes:
        mode: Whether it is recorded, and how it acts.
        number: Updates that its learner has made.
        is_exploring: Whether it acts at random.
        weights: What it acts with from now on; None: as before.
    """

    mode: Mode
    number: int = 0
    is_exploring: bool = False
    weights: Weights | None = None


@dataclass(frozen=True)
class Order:
    """What a worker does next.

    Attributes:
        policies: By name.
        updates: Updates of the run so far.
        num_steps: Steps of every engine to play.
        seed: Of the run's first world, to begin new episodes everywhere first; None to go on.
    """

    policies: Mapping[str, PolicyOrder]
    updates: int
    num_steps: int = 0
    seed: int | None = None


class Ended(NamedTuple):
    """Episodes of one policy that ended in one step of one engine.

    Attributes:
        step: Of the order.
        engine: Of the worker.
        policy: Whose.
        episodes: Which.
    """

    step: int
    engine: int
    policy: str
    episodes: EndedEpisodes


@dataclass(frozen=True)
class Report:
    """What came of an order.

    Attributes:
        recordings: By policy that learns.
        ended: Episodes that ended, in the order of steps and engines.
        num_steps: Agent steps of each policy.
        play_s: Seconds it took.
        num_restarts: Engines restarted so far.
    """

    recordings: Mapping[str, Recording]
    ended: list[Ended]
    num_steps: Mapping[str, int]
    play_s: float
    num_restarts: int


class Machine(Protocol):
    """The trainer's end of the line to a worker.

    Attributes:
        name: For messages, such as ``machine 2 (process 4711)``.
    """

    name: str

    def send(self, method: str, *arguments: Any) -> None:
        """Call a method of the worker and return at once."""
        ...

    def receive(self) -> Any:
        """Return what the method that was called last returned.

        Raises:
            LudusError: What the method raised.
            MachineLost: The worker died, or does not answer.
        """
        ...

    def close(self) -> None:
        """End the worker and its games; may be called twice."""
        ...
