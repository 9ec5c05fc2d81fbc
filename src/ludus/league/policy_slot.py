"""What acts in the slots of one policy of a run, and whether its learner learns from that."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import torch

from ludus.algorithms.learner import Learner
from ludus.league.league import League
from ludus.networks.policy import Player, Policy
from ludus.networks.tensors import to_numbers
from ludus.settings.policy_config import Mode
from ludus.spec.batch import ActionBatch, Batch

__all__ = ["PolicySlot"]


class PolicySlot:
    """One policy of a run, between the collector and its learner.

    In mode ``train`` the learner acts and records; in the others the policy acts as it is, and
    the learner is left alone. In slots where a league lets past selves play, they act, and the
    learner sees an inactive slot.

    Args:
        learner: Trains the policy.
        engine_slots: Slots of the policy in each engine.
        seed: Of the actions in mode ``frozen``.
        league: None without self-play.
    """

    def __init__(
        self, learner: Learner, engine_slots: list[int], seed: int, league: League | None = None
    ) -> None:
        self.learner = learner
        self._league = league
        self._engine_slots = engine_slots
        self._mode: Mode = "train"
        self._generator = torch.Generator(learner.policy.device).manual_seed(seed)
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
        generator = self._generator if mode == "frozen" else None
        self._players = [Player(self.policy, slots, generator) for slots in self._engine_slots]
        if mode == "train":
            for engine, batch in enumerate(self._batches):
                if batch is not None:
                    self.learner.begin(engine, batch)

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
        if self._league is None:
            return actions
        return self._league.replace_actions(engine, self.name, batch, actions)

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
        """Return mode and random stream as JSON values."""
        return {"mode": self._mode, "generator": to_numbers(self._generator.get_state())}

    def load_state(self, state: Mapping[str, Any]) -> None:
        """Go on from :meth:`state`; call :meth:`begin` next."""
        self._batches = [None] * len(self._engine_slots)
        self.set_mode(state["mode"])
        self._generator.set_state(torch.tensor(state["generator"], dtype=torch.uint8))

    def _take(self, engine: int, batch: Batch) -> Batch:
        if self._league is not None:
            batch = replace(batch, active=batch.active & self._league.is_live(engine, self.name))
        self._batches[engine] = batch
        return batch
