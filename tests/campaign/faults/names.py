"""Names that break paths, terminals, tables and formats: of folders, and of a game's policies."""

from __future__ import annotations

import json

from ludus.wire.frames import HEADER_BYTES, FrameType, encode_json
from tests.campaign.faults.kill import GAMES
from tests.campaign.faults.proxy import Rewrite, plant_proxy
from tests.campaign.promises import check_all, check_ending, check_nothing_left, check_nothing_ran
from tests.campaign.rounds import Finding, Round

__all__ = ["name_folders", "name_policies"]

NAMES = (
    "a b", "-rf", "--resume", "ünïcödé", "💥", "$x^2$", "$(touch canary)", "`id`", "a;b", "a'b",
    'a"b', "%s%n", "{0}", "{x}", "[red]x[/red]", "a\nb", "a\tb", "\x1b[2J", "\x1b]0;t\x07", "\x7f",
    "\u202eabc", "x" * 128, "y" * 250, "z" * 300, ".", "..", "../up", "/tmp/absolute", "a/b",
    "a/policy.x", "@league", "~", "CON", "nul", "a:b", "a*b", "a?b", "\ud800", "", " ", "\u00a0",
    "\u200b", "step-1", "policy.", "a.b", "policies", "agent\x00b",
)  # fmt: skip


def _draw_name(the_round: Round) -> str:
    chance = the_round.chance
    if chance.random() < 0.8:
        return chance.choice(NAMES)
    return "".join(chr(chance.choice([chance.randrange(1, 0x250), chance.randrange(1, 0xD7FF)]))
                   for _ in range(chance.randint(1, 20)))  # fmt: skip


def name_folders(the_round: Round) -> None:
    """Give a run, or the folder of all runs, such a name."""
    name = _draw_name(the_round)
    the_round.decide(f"name {name!r}")
    the_round.counts["names"] += 1
    outside = {path.name for path in the_round.folder.parent.iterdir()}
    trainer = the_round.begin(name=name)
    check_ending(trainer, 0, 2, 5)
    made = (
        [path for path in the_round.run.parent.iterdir()] if the_round.run.parent.exists() else []
    )
    if outside != {path.name for path in the_round.folder.parent.iterdir()}:
        raise Finding(f"the run {name!r} lies outside the folder of runs")
    if trainer.wait() == 0:
        the_round.run = made[0]
        check_all(the_round)
    check_nothing_left(the_round)
    check_nothing_ran(the_round)


def name_policies(the_round: Round) -> None:
    """Let a game call its policy so: it is trained under that name, or refused by it."""
    the_round.choose_engine(*GAMES)
    name = _draw_name(the_round)
    the_round.decide(f"policy {name!r}")
    the_round.counts["names"] += 1
    rename = _renaming(name)
    trainer = the_round.begin(before=lambda: plant_proxy([], rename))
    check_ending(trainer, 0, 2, 4)
    raw = trainer.output.read_bytes()
    for mark in (b"\x1b]0;", b"\x1b[2J", b"\x7f", b"\x07"):
        if mark in raw:
            raise Finding(f"control characters of a game were printed: {mark!r}")
    if trainer.wait() == 0:
        again = the_round.begin(
            resume=True,
            before=lambda: plant_proxy([], rename),
            total_steps=the_round.settings["total_steps"] + 32,
        )
        check_ending(again, 0)
    check_nothing_left(the_round)
    check_nothing_ran(the_round)


def _renaming(name: str) -> Rewrite:
    """Return what gives the first policy of a ``SPEC`` that passes another name."""
    pending = bytearray()
    is_done = False

    def rewrite(piece: bytes) -> bytes:
        nonlocal is_done
        if is_done:
            return piece
        pending.extend(piece)
        passed = bytearray()
        while len(pending) >= HEADER_BYTES:
            end = HEADER_BYTES + int.from_bytes(pending[:4], "little")
            if len(pending) < end:
                break
            frame, is_done = bytes(pending[:end]), pending[4] == FrameType.SPEC
            del pending[:end]
            if is_done:
                spec = json.loads(frame[HEADER_BYTES:])
                spec["policies"][0]["name"] = name
                passed += encode_json(FrameType.SPEC, spec) + pending
                return bytes(passed)
            passed += frame
        return bytes(passed)

    return rewrite
