"""SIGKILL for trainers and engines, at moments that matter and at any other.

A trainer dies right before its n-th change of the file system, or after some time. The first is
the same in every replay.
"""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tests.campaign.promises import check_all, check_checkpoints, check_ending
from tests.campaign.rounds import Round, TrainerProcess, pick

__all__ = ["die_at_change", "find_engine", "kill_engine", "kill_trainer", "kill_trainer_of_game"]

CHANGES = {"os.rename", "os.remove", "os.mkdir", "os.rmdir", "os.truncate", "os.link"}
MAX_CHANGES = 150
GAMES = ("godot4", "godot3", "bevy")
ENGINE_STARTS_WITHIN_S = 30.0


def kill_trainer(the_round: Round) -> None:
    """Kill a trainer, and those that resume its run, several times."""
    _kill_repeatedly(the_round, the_round.chance.randint(2, 8), longest_s=1.0)


def kill_trainer_of_game(the_round: Round) -> None:
    """Kill trainers that have a game process."""
    the_round.choose_engine(*GAMES)
    _kill_repeatedly(the_round, the_round.chance.randint(1, 3), longest_s=4.0)


def _kill_repeatedly(the_round: Round, times: int, longest_s: float) -> None:
    chance = the_round.chance
    for _ in range(times):
        after = chance.randrange(MAX_CHANGES) if chance.random() < 0.7 else None
        delay_s = chance.uniform(0.0, longest_s)
        can_resume = (the_round.run / "config.json").exists() and bool(the_round.saved())
        if not can_resume and the_round.run.exists():
            the_round.run = the_round.run.with_name(f"{the_round.run.name}-again")
        # So that there is something left to train, and to kill.
        more = {"total_steps": 100_000} if can_resume else {}
        before = None if after is None else die_at_change(after, the_round.run)
        where = f"{delay_s:.3f} s" if after is None else f"change {after}"
        the_round.decide(f"kill the trainer after {where}")
        trainer = the_round.begin(resume=can_resume, before=before, **more)
        if after is None and trainer.wait(delay_s) is None:
            trainer.signal(signal.SIGKILL)
        check_ending(trainer, -signal.SIGKILL, 2, 5)
        the_round.counts["kills"] += trainer.wait() == -signal.SIGKILL
        check_checkpoints(the_round)
    check_all(the_round)


def die_at_change(number: int, folder: Path) -> Callable[[], None]:
    """Return what makes a process die before its ``number``-th change inside a folder."""

    def plant() -> None:
        left = number
        absolute, relative = os.fspath(folder), os.path.relpath(folder)

        def watch(event: str, arguments: tuple[Any, ...]) -> None:
            nonlocal left
            is_change = event in CHANGES or (event == "open" and _is_writing(arguments))
            if is_change and str(arguments[0]).startswith((absolute, relative)):
                left -= 1
                if left < 0:
                    os.kill(os.getpid(), signal.SIGKILL)

        sys.addaudithook(watch)

    return plant


def _is_writing(arguments: tuple[Any, ...]) -> bool:
    flags = arguments[2]
    return isinstance(flags, int) and bool(flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT))


def kill_engine(the_round: Round) -> None:
    """Kill the game below a trainer, which starts another."""
    the_round.choose_engine(*GAMES)
    chance = the_round.chance
    moments = [(chance.uniform(0.0, 2.0), chance.random()) for _ in range(chance.randint(1, 3))]
    trainer = the_round.begin(total_steps=800)
    for delay_s, share in moments:
        the_round.decide(f"kill the engine {delay_s:.3f} s after it has begun")
        pid = find_engine(the_round, trainer, share)
        if pid is None:
            break
        if trainer.wait(delay_s) is None and pid in the_round.processes():
            os.kill(pid, signal.SIGKILL)
            the_round.counts["kills"] += 1
            trainer.wait(0.2)
    check_ending(trainer, 0, 4)
    check_all(the_round)


def find_engine(the_round: Round, trainer: TrainerProcess, share: float) -> int | None:
    """Wait for a process that the trainer has started; None if the trainer ends first."""
    deadline = time.monotonic() + ENGINE_STARTS_WITHIN_S
    while time.monotonic() < deadline and trainer.wait(0.01) is None:
        if pids := the_round.processes():
            return pick(pids, share)
    return None
