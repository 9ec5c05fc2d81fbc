"""Carry out the requests of a game that guides its training: stand by, train, play a round."""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from ludus.disk import disk_errors
from ludus.errors import LudusError, UsageError
from ludus.export.convert import to_model
from ludus.export.places import place_files
from ludus.model.json_file import write_model
from ludus.play.evaluation import play_round
from ludus.play.players import trained_player
from ludus.pool.interface import Pool
from ludus.runs.control import (
    PlayRound,
    Request,
    SaveRequest,
    SetMode,
    StartRequest,
    StopRequest,
    WritePolicies,
    parse_request,
    take_requests,
)
from ludus.runs.run_list import StopReason
from ludus.serve.guided.game_run import GameRun
from ludus.session import GuidedSession
from ludus.training.progress import SilentReporter

__all__ = ["Game", "Guidance", "State"]

POLL_S = 0.05
STATUS_EVERY_S = 0.5
ROUND_SEED = 1_000_003
"""Distance between the seeds of rounds, and of rounds from training."""

State = Literal["standby", "training", "playing", "ended"]
"""What the server does; ``ended``: a game that does not guide its training has said stop."""

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Game:
    """A connected game.

    Attributes:
        session: The session with it.
        pool: The pool over that session.
    """

    session: GuidedSession
    pool: Pool


class Guidance:
    """Carries out the requests of one game, and reports progress to it.

    It is also the trainer's :class:`~ludus.training.trainer.TrainerCallback`. A game that does not
    guide its training is trained from the start until it says stop.

    Args:
        game: The game.
        run: Its run.
        policies: Folder for its exported policies; None: in the run's folder.
    """

    def __init__(self, game: Game, run: GameRun, policies: Path | None) -> None:
        self._session = game.session
        self._pool = game.pool
        self._run = run
        self._policies_folder = policies or run.policies_folder
        self._idle_state: State = "standby" if game.session.is_guided else "ended"
        self._state: State = self._idle_state if game.session.is_guided else "training"
        self._next: State = self._state
        self._after_round: State = self._idle_state
        self._message = run.message
        self._pending_report: dict[str, Any] = {}
        self._status_due_at = 0.0
        self._shown_updates = -1
        self._num_rounds = 0

    def conduct(self, is_stopping: Callable[[], bool]) -> StopReason:
        """Carry out requests until ``is_stopping``, or until the run has ended.

        Raises:
            EngineError: The game is gone or made a mistake; training progress is saved.
            DivergenceError: A loss became NaN or infinite.
            RunError: A file cannot be written.
        """
        log.info("%s", self._message)
        while not is_stopping() and self._next != "ended":
            self._enter(self._next)
            match self._state:
                case "training":
                    self._train(is_stopping)
                case "playing":
                    self._play(is_stopping)
                case _:
                    self._stand_by(is_stopping)
        return "interrupted" if is_stopping() else "stopped"

    def is_due(self) -> bool:
        """Return whether the game has requests, or a status report is due."""
        return self._session.has_requests or time.monotonic() >= self._status_due_at

    def call(self) -> bool:
        """Report and handle requests; return whether the current state has to end."""
        if self._run.trainer.updates != self._shown_updates:
            self._show_status()
        requests = [*self._session.take_requests(), *take_requests(self._run.folder.control)]
        for values in requests:
            self._apply(values)
        if self._next == self._state and (requests or time.monotonic() >= self._status_due_at):
            self._show_status()
        return self._next != self._state

    # --- states ---------------------------------------------------------------------------------

    def _enter(self, state: State) -> None:
        if state != self._state:
            log.info("%s, at %d agent steps", state, self._run.trainer.agent_steps)
        self._state = state
        self._show_status()
        if state == "standby":
            self._session.stand_by()

    def _stand_by(self, is_stopping: Callable[[], bool]) -> None:
        while not is_stopping() and not self.call():
            time.sleep(POLL_S)

    def _train(self, is_stopping: Callable[[], bool]) -> None:
        self._run.trainer.run(is_stopping, SilentReporter(), self)
        self._say_saved()

    def _play(self, is_stopping: Callable[[], bool]) -> None:
        policies = {name: learner.policy for name, learner in self._run.learners.items()}
        self._num_rounds += 1
        seed = (self._run.config.seed or 0) + ROUND_SEED * self._num_rounds
        act = trained_player(policies, self._pool, seed)

        def is_ending() -> bool:
            return is_stopping() or (self.is_due() and self.call())

        played = play_round(act, self._pool, seed, is_ending)
        if played is not None:
            self._pending_report["round"] = {
                name: {"mean_return": of.mean_return, "episodes": of.num_episodes}
                for name, of in played.items()
            }
            self._say("played a round")
            self._next = self._after_round

    # --- requests -------------------------------------------------------------------------------

    def _apply(self, values: Any) -> None:
        try:
            self._do(parse_request(values, self._pool.policies))
        except LudusError as error:
            self._warn(f"{error.message} ({error.hint})" if error.hint else error.message)

    def _do(self, request: Request) -> None:
        """Carry out a request at once, or set the state that follows.

        Raises:
            LudusError: The request cannot be carried out; nothing has changed.
        """
        match request:
            case SetMode(policy, mode):
                self._run.trainer.set_mode(policy, mode)
                self._say(f"policy {policy}: {mode}")
            case SaveRequest():
                self._run.trainer.save()
                self._say_saved()
            case WritePolicies():
                self._write_policies()
            case StartRequest():
                if "training" in (self._next, self._after_round):
                    raise UsageError("training is running already")
                if self._next == "playing":
                    self._after_round = "training"
                else:
                    self._next = "training"
            case PlayRound():
                if self._next == "playing":
                    raise UsageError("a round is being played already")
                self._after_round, self._next = self._next, "playing"
            case StopRequest():
                if self._next == self._idle_state:
                    raise UsageError("there is nothing to stop")
                self._next = self._after_round = self._idle_state

    def _write_policies(self) -> None:
        folder, learners = self._policies_folder, self._run.learners
        places = place_files(list(learners), f"{folder}{os.sep}", self._run.folder.path)
        with disk_errors(f"the folder {folder}"):
            folder.mkdir(parents=True, exist_ok=True)
        for place, learner in zip(places, learners.values(), strict=True):
            write_model(place, to_model(learner.policy, learner.policy.spec))
        self._pending_report["written"] = {
            name: str(place.resolve()) for name, place in zip(learners, places, strict=True)
        }
        self._say(f"wrote policies to {folder.resolve()}")

    # --- reports --------------------------------------------------------------------------------

    def _say(self, message: str) -> None:
        self._message = message
        log.info("%s", message)

    def _say_saved(self) -> None:
        self._say(f"saved checkpoint at {self._run.trainer.agent_steps} steps")

    def _warn(self, message: str) -> None:
        self._message = message
        log.warning("%s", message)

    def _show_status(self) -> None:
        self._status_due_at = time.monotonic() + STATUS_EVERY_S
        self._shown_updates = self._run.trainer.updates
        pending_report, self._pending_report = self._pending_report, {}
        self._pool.show_status({
            **self._run.trainer.status(),
            "state": self._state,
            "run": str(self._run.folder.path.resolve()),
            "message": self._message,
            **pending_report,
        })  # fmt: skip
