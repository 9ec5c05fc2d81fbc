"""SIGKILL and SIGSTOP for the workers of a cluster, and SIGKILL for the trainer above them."""

from __future__ import annotations

import contextlib
import os
import signal
from pathlib import Path

from ludus.workers import process
from tests.campaign.faults.kill import GAMES, find_engine
from tests.campaign.promises import check_all, check_ending
from tests.campaign.rounds import Round, pick

__all__ = ["harm_workers"]

SILENCE_S = 6.0
"""In the place of 30 s, so that a round takes seconds."""


def harm_workers(the_round: Round) -> None:
    """Kill or stop workers, one after another, and sometimes the trainer; its run goes on."""
    the_round.choose_engine("gym", *GAMES)
    chance = the_round.chance
    harms = [
        (chance.uniform(0.0, 4.0), chance.random(), chance.choice(["kill", "kill", "stop"]))
        for _ in range(chance.randint(1, 3))
    ]
    kills_trainer = chance.random() < 0.3
    trainer = the_round.begin(before=_be_impatient, cluster="local:2", total_steps=6000)
    for delay_s, share, harm in harms:
        the_round.decide(f"{harm} a worker {delay_s:.3f} s after there is one")
        if find_engine(the_round, trainer, share) is None or trainer.wait(delay_s) is not None:
            break
        workers = [pid for pid in the_round.processes() if _is_worker(pid)]
        if workers:
            with contextlib.suppress(ProcessLookupError):  # it has just ended
                number = signal.SIGKILL if harm == "kill" else signal.SIGSTOP
                os.kill(pick(workers, share), number)
                the_round.counts["kills" if harm == "kill" else "stops"] += 1
    if kills_trainer:
        the_round.decide("kill the trainer")
        trainer.wait(0.5)
        trainer.signal(signal.SIGKILL)
        the_round.counts["kills"] += 1
    check_ending(trainer, -signal.SIGKILL if kills_trainer else 0, 5)
    check_all(the_round)


def _is_worker(pid: int) -> bool:
    with contextlib.suppress(OSError):
        return b"ludus.workers.process" in Path(f"/proc/{pid}/cmdline").read_bytes()
    return False


def _be_impatient() -> None:
    process.SILENCE_S = SILENCE_S
