"""SIGSTOP for trainers and engines, for a while or for good."""

from __future__ import annotations

import contextlib
import os
import signal

from tests.campaign.faults.kill import GAMES, find_engine
from tests.campaign.promises import check_all, check_ending
from tests.campaign.rounds import Round
from tests.campaign.trainer import STEP_TIMEOUT_S

__all__ = ["stop_engine", "stop_trainer"]


def stop_trainer(the_round: Round) -> None:
    """Stop a trainer and let it go on; its game waits."""
    the_round.choose_engine("gym", *GAMES)
    chance = the_round.chance
    delay_s, pause_s = chance.uniform(0.0, 2.0), chance.uniform(0.0, STEP_TIMEOUT_S + 2.0)
    the_round.decide(f"stop the trainer after {delay_s:.3f} s, for {pause_s:.3f} s")
    trainer = the_round.begin()
    if trainer.wait(delay_s) is None:
        trainer.signal(signal.SIGSTOP)
        the_round.counts["stops"] += 1
        trainer.wait(pause_s)
        trainer.signal(signal.SIGCONT)
    # Where its own clock has run out meanwhile, it may take the game for frozen.
    check_ending(trainer, 0, 4)
    check_all(the_round)


def stop_engine(the_round: Round) -> None:
    """Stop a game: for a moment, or for longer than the trainer waits."""
    the_round.choose_engine(*GAMES)
    chance = the_round.chance
    delay_s, pause_s = chance.uniform(0.0, 2.0), chance.uniform(0.0, STEP_TIMEOUT_S + 2.0)
    is_for_good = chance.random() < 0.3
    share = chance.random()
    what = "good" if is_for_good else f"{pause_s:.3f} s"
    the_round.decide(f"stop the engine {delay_s:.3f} s after it has begun, for {what}")
    trainer = the_round.begin(total_steps=400)
    pid = find_engine(the_round, trainer, share)
    if pid is not None and trainer.wait(delay_s) is None and pid in the_round.processes():
        os.kill(pid, signal.SIGSTOP)
        the_round.counts["stops"] += 1
        if not is_for_good:
            trainer.wait(pause_s)
            with contextlib.suppress(ProcessLookupError):  # the trainer has ended it
                os.kill(pid, signal.SIGCONT)
    check_ending(trainer, 0, 4)
    check_all(the_round)
