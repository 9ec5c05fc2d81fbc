"""Truncated files and flipped bytes, in anything that a run has written."""

from __future__ import annotations

import json
import random
import shutil
import signal
from pathlib import Path
from typing import Any

from tests.campaign.faults.kill import MAX_CHANGES, die_at_change
from tests.campaign.promises import check_all, check_ending
from tests.campaign.rounds import Round, pick

__all__ = ["damage_files"]

KINDS = (
    "truncate",
    "flip",
    "flip",
    "empty",
    "zeros",
    "noise",
    "nesting",
    "other JSON",
    "directory",
)


def damage_files(the_round: Round) -> None:
    """End a run, or kill it, and change one to three of its files."""
    chance = the_round.chance
    last = chance.randrange(40, MAX_CHANGES)
    is_killed = chance.random() < 0.5
    wishes = [(chance.random(), chance.choice(KINDS), chance.getrandbits(64))
              for _ in range(chance.choice([1, 1, 2, 3]))]  # fmt: skip
    trainer = the_round.begin(before=die_at_change(last, the_round.run) if is_killed else None)
    check_ending(trainer, -signal.SIGKILL)
    the_round.counts["kills"] += trainer.wait() == -signal.SIGKILL
    if the_round.run.exists():
        shutil.copytree(the_round.run, the_round.folder / "whole")
    files = [path for path in sorted(the_round.run.rglob("*")) if path.is_file()]
    for share, kind, seed in wishes if files else ():
        path: Path = pick(files, share)
        if path.is_file() and damage(path, kind, random.Random(seed)):
            the_round.decide(f"{kind} in {path.relative_to(the_round.run)}")
            the_round.damaged.add(path)
            the_round.counts["damages"] += 1
    check_all(the_round)


def damage(path: Path, kind: str, chance: random.Random) -> bool:
    """Change a file in one of :data:`KINDS`; return whether it is another one now."""
    before = bytearray(path.read_bytes())
    data = before.copy()
    match kind:
        case "truncate":
            data = data[: int(chance.random() * len(data))]
        case "flip":
            for _ in range(min(len(data), chance.choice([1, 1, 8]))):
                data[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
        case "empty":
            data.clear()
        case "zeros":  # what some file systems leave after a loss of power
            data[int(chance.random() * len(data)) :] = bytes(len(data))
        case "noise":
            data = bytearray(chance.randbytes(chance.randint(1, 300)))
        case "nesting":
            data = bytearray(b"[" * 200_000)
        case "other JSON":
            wrong: list[Any] = [
                None,
                [],
                {},
                7,
                "x",
                {"format": 2},
                {"policies": [1]},
                {"target": {}},
            ]
            data = bytearray(json.dumps(chance.choice(wrong)).encode())
        case _:
            path.unlink()
            path.mkdir()
            return True
    path.write_bytes(data)
    return data != before
