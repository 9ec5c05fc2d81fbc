"""Requests of games and users to a run, and reports to the games."""

from __future__ import annotations

import logging
from pathlib import Path

from ludus.pool.interface import Pool
from ludus.runs.control import SaveRequest, SetMode, StopRequest, read_request, take_requests
from ludus.training.trainer import Trainer

__all__ = ["RunCallback"]

STATUS_EVERY_S = 0.5
"""Seconds of training between two reports to the games."""

log = logging.getLogger(__name__)


class RunCallback:
    """Handles the requests of a run that no game guides, after every update.

    Args:
        trainer: What the requests change.
        pool: Games that send requests and show the status.
        control: Folder with requests of users.
    """

    def __init__(self, trainer: Trainer, pool: Pool, control: Path) -> None:
        self._trainer = trainer
        self._pool = pool
        self._control = control
        self._status_at_s = 0.0

    def is_due(self) -> bool:
        """Return False: requests wait until after an update."""
        return False

    def call(self) -> bool:
        """Handle what games and the control folder ask for; return whether that is to stop."""
        if self._apply():
            return True
        self._show_status()
        return False

    def _apply(self) -> bool:
        is_stopping = False
        for values in [*self._pool.take_requests(), *take_requests(self._control)]:
            match read_request(values, self._pool.policies):
                case SetMode(policy, mode):
                    self._trainer.set_mode(policy, mode)
                case SaveRequest():
                    self._trainer.save()
                case StopRequest():
                    is_stopping = True
                case None:
                    pass
                case request:
                    log.warning("ignoring %s: only ludus serve can do that", request.to_json())
        return is_stopping

    def _show_status(self) -> None:
        """Show the games the status, twice per second at most."""
        if self._trainer.wall_s - self._status_at_s < STATUS_EVERY_S:
            return
        self._status_at_s = self._trainer.wall_s
        self._pool.show_status(self._trainer.status())
