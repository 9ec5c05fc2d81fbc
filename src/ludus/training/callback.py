"""Requests of games and users to a run, callbacks of scripts, and reports to the games."""

from __future__ import annotations

import logging

from ludus.play.episodes import EndedEpisodes
from ludus.pool.interface import Pool
from ludus.runs.control import SaveRequest, SetMode, StopRequest, read_request, take_requests
from ludus.training.hooks import Episode, Hooks, Training
from ludus.training.trainer import Trainer

__all__ = ["RunCallback"]

log = logging.getLogger(__name__)


class RunCallback:
    """Handles the requests of a run that no game guides, before the first update and after each.

    The games are told how it goes, and what they ask for in answer is in effect for the next
    update; so a game can say for each update who learns.

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
        self._num_updates: int | None = None
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
        if self._trainer.updates != self._num_updates:
            is_first, self._num_updates = self._num_updates is None, self._trainer.updates
            self._pool.show_status(self._trainer.status())
            if self._apply_requests():
                return True
            if self._hooks.on_update is not None and not is_first:
                self._hooks.on_update(self._training)
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
        requests = [*self._pool.take_requests(), *take_requests(self._training.folder.control)]
        for values in requests:
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
        if requests:
            self._pool.show_status(self._trainer.status())
        return is_stopping
