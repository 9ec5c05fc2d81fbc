"""What a trainer needs from whoever plays, and what a worker needs from its trainer.

A worker plays all engines of one machine. It gets one call for each rollout: an :class:`Order` with
the weights of the policies that changed; its answer is a :class:`Report`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

from numpy.typing import NDArray

from ludus.algorithms.recorder import Recording, Weights
from ludus.curriculum.world_parameters import Sums
from ludus.league.seats import Match
from ludus.play.episodes import EndedEpisodes
from ludus.settings.policy_config import Mode
from ludus.wire.requests import MetricSummary
from ludus.workers.collect import CollectTimes, OnEpisodes

__all__ = ["Ended", "LeagueOrder", "Machine", "MachineState", "Order", "PolicyOrder", "Report",
           "Workers"]  # fmt: skip


@dataclass(frozen=True)
class MachineState:
    """How one of the machines of a run does.

    Attributes:
        name: For people.
        num_engines: Engines that it plays.
        play_s: Seconds that it plays for one answer, lately.
        is_lost: Whether its worker is gone, and not started again yet.
    """

    name: str
    num_engines: int
    play_s: float
    is_lost: bool


class Workers(Protocol):
    """Plays all engines of a run.

    Attributes:
        times: Where the time went.
        on_episodes: Gets the episodes that end.
    """

    times: CollectTimes
    on_episodes: OnEpisodes | None

    @property
    def machines(self) -> Sequence[MachineState]:
        """How the machines do; none where this process plays itself."""
        ...

    @property
    def num_steps(self) -> int:
        """Agent steps so far, of all policies."""
        ...

    def advance(self, updates: int) -> None:
        """Note how many updates the run has made; after each, and before a reset."""
        ...

    def playing(self, policy: str) -> set[int]:
        """Return the numbers of the past selves of ``policy`` that play somewhere."""
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
        league: What self-play needs; None: as before.
    """

    policies: Mapping[str, PolicyOrder]
    updates: int
    num_steps: int = 0
    seed: int | None = None
    league: LeagueOrder | None = None


@dataclass(frozen=True)
class LeagueOrder:
    """Whom past selves play for, from now on.

    Attributes:
        learning: Policies that learn.
        opponents: Numbers of the past selves of each policy that may be drawn.
        past: State of each of them, by policy and number.
    """

    learning: frozenset[str]
    opponents: Mapping[str, Sequence[int]]
    past: Mapping[str, Mapping[int, Mapping[str, NDArray[Any]]]]


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
        metrics: What the games have reported since the last time.
        draws: What was drawn for worlds since then.
        matches: Games of self-play that ended, each with its step of the order and its engine.
        playing: Past selves of each policy that play.
    """

    recordings: Mapping[str, Recording]
    ended: list[Ended]
    num_steps: Mapping[str, int]
    play_s: float
    num_restarts: int
    metrics: dict[str, MetricSummary]
    draws: Sums
    matches: list[tuple[int, int, Match]]
    playing: Mapping[str, set[int]]


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
