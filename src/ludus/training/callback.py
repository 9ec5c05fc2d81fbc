"""Who looks after the games while a trainer trains: hears what they want, tells how it goes."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from ludus.pool.interface import Pool
from ludus.runs.control import SaveRequest, SetMode, StopRequest, read_request, take_requests

if TYPE_CHECKING:
    from ludus.training.trainer import Trainer

__all__ = ["Attendant", "RunAttendant"]

STATUS_EVERY_S = 0.5
"""Seconds of training between two reports to the games."""

log = logging.getLogger(__name__)


class Attendant(Protocol):
    """Is asked by a trainer between steps."""

    def is_needed(self) -> bool:
        """Return whether to look after the games now; asked before each step, so it is quick.

        What was collected so far is not lost.
        """
        ...

    def attend(self) -> bool:
        """Look after the games, as :meth:`is_needed` asked for or after an update.

        Returns:
            Whether training has to end.
        """
        ...


class RunAttendant:
    """Looks after the games of a run that nobody guides: after each update, and not between them.

    Args:
        trainer: What it does to them.
        pool: The games.
        control: Folder for requests.
    """

    def __init__(self, trainer: Trainer, pool: Pool, control: Path) -> None:
        self._trainer = trainer
        self._pool = pool
        self._control = control
        self._status_at_s = 0.0

    def is_needed(self) -> bool:
        """Return False: after an update is soon enough."""
        return False

    def attend(self) -> bool:
        """Do what games and control folder ask for; return whether that is to stop."""
        if self._obey():
            return True
        self._show_status()
        return False

    def _obey(self) -> bool:
        is_stopping = False
        for wish in [*self._pool.take_requests(), *take_requests(self._control)]:
            match read_request(wish, self._pool.policies):
                case SetMode(policy, mode):
                    self._trainer.set_mode(policy, mode)
                case SaveRequest():
                    self._trainer.save()
                case StopRequest():
                    is_stopping = True
                case None:
                    pass
                case request:
                    log.warning("request left out: only ludus serve can %s", request.to_json())
        return is_stopping

    def _show_status(self) -> None:
        """Tell the games how it goes, once in a while."""
        if self._trainer.wall_s - self._status_at_s < STATUS_EVERY_S:
            return
        self._status_at_s = self._trainer.wall_s
        self._pool.show_status(self._trainer.status())
