"""Tells a game that shows an agent what was decided for it, and how probable that was."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol, runtime_checkable

from ludus.pool import EnginePool
from ludus.session.engine_session import BRIDGE
from ludus.spec.batch import ActionBatch, Batches
from ludus.spec.decision import Decision

__all__ = ["Describes", "WatchedPlayer"]

KIND = "watch"
METHOD = "show_decision"


@runtime_checkable
class Describes(Protocol):
    """A player that knows how probable its last actions were."""

    def __call__(self, batches: Batches) -> Mapping[str, ActionBatch]:
        """Return the actions on what all agents see."""
        ...

    def describe(self, policy: str, slot: int) -> Decision:
        """Return what was decided last for one agent."""
        ...


class WatchedPlayer:
    """Acts as a player does, and tells the game of each decision of the agent that it shows.

    A game asks for that with requests of the kind ``watch`` while it shows an agent. As long as
    none does, a step costs nothing more.

    Args:
        pool: One engine.
        act: What decides. One that is not :class:`Describes`, such as chance, tells nothing.
    """

    def __init__(self, pool: EnginePool, act: Any) -> None:
        self._pool = pool
        self._act = act
        self._watched: tuple[str, int] | None = None

    def __call__(self, batches: Batches) -> Mapping[str, ActionBatch]:
        """Return the actions of ``act``."""
        for request in self._pool.take_requests():
            if request["kind"] == KIND:
                self._watched = self._read(request)
        actions = self._act(batches)
        if self._watched is not None and isinstance(self._act, Describes):
            policy, slot = self._watched
            told = {"policy": policy, "slot": slot, **self._act.describe(policy, slot)}
            self._pool.call(BRIDGE, METHOD, [told])
        return actions

    def _read(self, request: Mapping[str, Any]) -> tuple[str, int] | None:
        """Return whom the game shows; None where it shows nobody that there is."""
        policy, slot = request.get("policy"), request.get("slot")
        if not isinstance(policy, str) or policy not in self._pool.policies:
            return None
        if not isinstance(slot, int | float) or not 0 <= slot < self._pool.num_agents(policy):
            return None
        return policy, int(slot)
