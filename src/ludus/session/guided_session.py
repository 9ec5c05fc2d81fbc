"""A session with a game that guides its own training (PROTOCOL.md §8, "Standing by")."""

from __future__ import annotations

from typing import ClassVar

from ludus.errors import UsageError
from ludus.session.engine_session import BRIDGE, EngineSession
from ludus.spec.batch import Batches
from ludus.wire.requests import CAPABILITY as REQUESTS
from ludus.wire.reset import ResetRequest
from ludus.wire.training import CAPABILITY as GUIDED

__all__ = ["GuidedSession"]


class GuidedSession(EngineSession):
    """One game that may tell the trainer what to do; see :class:`EngineSession`.

    Between :meth:`stand_by` and the next :meth:`reset` the game runs freely, and every call of
    :meth:`take_requests` asks it for requests.
    """

    _more_capabilities: ClassVar[frozenset[str]] = frozenset({GUIDED})
    _is_standing_by = False

    @property
    def is_guided(self) -> bool:
        """Whether the game tells the trainer what to do."""
        has_both = {GUIDED, REQUESTS} <= self.hello.capabilities
        return has_both and self.hello.training is not None

    @property
    def has_requests(self) -> bool:
        """Whether requests may be waiting: always true while the game stands by."""
        return self._is_standing_by or super().has_requests

    def stand_by(self) -> None:
        """Let the game run freely until the next :meth:`reset`.

        Raises:
            UsageError: The game does not guide its training.
            SequenceError: The answer to ``send`` was not received yet.
            EngineError: The engine failed.
        """
        if not self.is_guided:
            raise UsageError("only a game that guides its training can stand by")
        self.call(BRIDGE, "stand_by")
        self._is_standing_by = True
        self._link.spin(0.0)  # latency does not matter now, so leave the core to others

    def reset(self, request: ResetRequest) -> Batches:
        """Begin new episodes and return to lock-step; see :meth:`EngineSession.reset`."""
        self._is_standing_by = False
        self._link.spin(self._spin_s)
        return super().reset(request)
