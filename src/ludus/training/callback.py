"""Requests of games and users to a run, callbacks of scripts, and reports to the games."""

from __future__ import annotations

import logging

from ludus.play.episodes import EndedEpisodes
from ludus.pool.interface import Pool
from ludus.runs.control import SaveRequest, SetMode, StopRequest, read_request, take_requests
from ludus.training.hooks import Episode, Hooks, Training
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
        training: What callbacks see; the run's folder ``control`` has requests of users.
        hooks: Callbacks of a script.
    """

    def __init__(self, trainer: Trainer, pool: Pool, training: Training, hooks: Hooks) -> None:
        self._trainer = trainer
        self._pool = pool
        self._training = training
        self._hooks = hooks
        self._error: Exception | None = None
        self._num_updates = trainer.updates
        self._status_at_s = 0.0
        if hooks.on_episode is not None:
            trainer.follow_episodes(self._report_episodes)

    def is_due(self) -> bool:
        """Return whether a callback wants something; requests wait until after an update."""
        training = self._training
        return self._error is not None or training.is_stopping or training.has_changed

    def call(self) -> bool:
        """Handle what games, scripts and the control folder ask for; return whether to stop."""
        if self._error is not None:
            raise self._error
        if self._trainer.updates > self._num_updates:
            self._num_updates = self._trainer.updates
            if self._apply_requests():
                return True
            if self._hooks.on_update is not None:
                self._hooks.on_update(self._training)
            self._show_status()
        self._training.apply()
        return self._training.is_stopping

    def _report_episodes(self, policy: str, first: int, ended: EndedEpisodes) -> None:
        """Call ``on_episode``; what it raises waits until no engine is in a step."""
        assert self._hooks.on_episode is not None
        outcomes = zip(ended.returns.tolist(), ended.lengths.tolist(), strict=True)
        try:
            for number, outcome in enumerate(outcomes, first):
                if self._error is None:
                    self._hooks.on_episode(self._training, Episode(policy, number, *outcome))
        except Exception as error:
            self._error = error

    def _apply_requests(self) -> bool:
        is_stopping = False
        for values in [*self._pool.take_requests(), *take_requests(self._training.folder.control)]:
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
