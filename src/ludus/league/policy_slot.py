"""What acts in the slots of one policy of a run, and whether its learner learns from that."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Protocol

import torch

from ludus.algorithms.learners import policy_seed
from ludus.algorithms.recorder import stream_seed
from ludus.league.seats import Seats
from ludus.networks.policy import Player, Policy
from ludus.settings.policy_config import Mode
from ludus.spec.batch import ActionBatch, Batch

__all__ = ["Plays", "PolicySlot", "frozen_seed"]


class Plays(Protocol):
    """What of a :class:`~ludus.algorithms.learner.Learner` a slot needs."""

    @property
    def policy(self) -> Policy:
        """What acts."""
        ...

    @property
    def num_steps_left(self) -> int:
        """Steps of every engine until the next update."""
        ...

    def begin(self, engine: int, batch: Batch) -> None:
        """Take the first observations of an engine that was reset."""
        ...

    def act(self, engine: int) -> ActionBatch:
        """Return the actions for the last observations."""
        ...

    def record(self, engine: int, batch: Batch) -> None:
        """Take the outcome of the last actions, and the observations to act on next."""
        ...

    def learn_while_stepping(self) -> None:
        """Learn a little while engines simulate."""
        ...


def frozen_seed(seed: int | None, policy: str) -> int:
    """Return the seed of what a policy of a run draws in mode ``frozen``."""
    return policy_seed((seed or 0) + 1, policy)


class PolicySlot:
    """One policy of a run, between the collector and its learner.

    In mode ``train`` the learner acts and records; in the others the policy acts as it is, and
    the learner is left alone. In slots where a league lets past selves play, they act, and the
    learner sees an inactive slot.

    Args:
        learner: Trains the policy.
        engine_slots: Slots of the policy in each engine.
        seed: Of the actions in mode ``frozen``.
        seats: None without self-play.
        first_engine: Number of the first engine among those of all machines.
    """

    def __init__(
        self,
        learner: Plays,
        engine_slots: list[int],
        seed: int,
        seats: Seats | None = None,
        first_engine: int = 0,
    ) -> None:
        self.learner = learner
        self._seats = seats
        self._engine_slots = engine_slots
        self._mode: Mode = "train"
        self._seed = seed
        self._first_engine = first_engine
        self._generators = [torch.Generator(learner.policy.device) for _ in engine_slots]
        self._players: list[Player] = []
        self._batches: list[Batch | None] = [None] * len(engine_slots)

    @property
    def policy(self) -> Policy:
        """What acts here."""
        return self.learner.policy

    @property
    def name(self) -> str:
        """Name of the policy."""
        return self.policy.spec.name

    @property
    def mode(self) -> Mode:
        """Whether the policy learns, and how it acts; see :data:`Mode`."""
        return self._mode

    @property
    def num_steps_left(self) -> int | None:
        """Steps of every engine until the next update; None while nothing is learnt."""
        return self.learner.num_steps_left if self._mode == "train" else None

    def set_mode(self, mode: Mode) -> None:
        """Change the mode; only between two updates, when nothing is under way.

        A rollout that was begun is dropped when learning stops.
        """
        if mode == self._mode:
            return
        self._mode = mode
        self._players = [
            Player(self.policy, slots, generator if mode == "frozen" else None)
            for slots, generator in zip(self._engine_slots, self._generators, strict=True)
        ]
        if mode == "train":
            for engine, batch in enumerate(self._batches):
                if batch is not None:
                    self.learner.begin(engine, batch)

    def advance(self, updates: int) -> None:
        """Draw the actions of mode ``frozen`` from streams that nothing but ``updates`` decides."""
        for engine, generator in enumerate(self._generators, self._first_engine):
            generator.manual_seed(stream_seed(self._seed, updates, engine))

    def begin(self, engine: int, batch: Batch) -> Batch:
        """Take the first observations of an engine that was reset.

        Returns:
            The batch as the policy itself sees it: slots of past selves are inactive.
        """
        own = self._take(engine, batch)
        if self._mode == "train":
            self.learner.begin(engine, own)
        else:
            self._players[engine].forget()
        return own

    def act(self, engine: int) -> ActionBatch:
        """Return the actions of all slots of an engine."""
        batch = self._batches[engine]
        assert batch is not None, "begin comes first"
        if self._mode == "train":
            actions = self.learner.act(engine)
        else:
            actions = self._players[engine].act(batch)
        if self._seats is None:
            return actions
        return self._seats.replace_actions(engine, self.name, batch, actions)

    def record(self, engine: int, batch: Batch) -> Batch:
        """Take the outcome of the last actions, and what to act on next; returns as ``begin``."""
        own = self._take(engine, batch)
        if self._mode == "train":
            self.learner.record(engine, own)
        return own

    def learn_while_stepping(self) -> None:
        """Learn a little while engines simulate."""
        if self._mode == "train":
            self.learner.learn_while_stepping()

    def state(self) -> dict[str, Any]:
        """Return the mode as a JSON value."""
        return {"mode": self._mode}

    def load_state(self, state: Mapping[str, Any]) -> None:
        """Go on from :meth:`state`; call :meth:`begin` next."""
        self._batches = [None] * len(self._engine_slots)
        self.set_mode(state["mode"])

    def _take(self, engine: int, batch: Batch) -> Batch:
        if self._seats is not None:
            batch = replace(batch, active=batch.active & self._seats.is_live(engine, self.name))
        self._batches[engine] = batch
        return batch
