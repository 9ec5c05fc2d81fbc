"""Delays, cuts, flipped bytes and garbage between a trainer and a real game."""

from __future__ import annotations

from tests.campaign.faults.kill import GAMES
from tests.campaign.faults.proxy import Lie, plant_proxy
from tests.campaign.promises import check_all, check_ending
from tests.campaign.rounds import Round
from tests.campaign.trainer import STEP_TIMEOUT_S

__all__ = ["lie_on_the_wire"]

KINDS = ("delay", "cut", "flip", "flip", "insert", "drop")


def lie_on_the_wire(the_round: Round) -> None:
    """Lie once to three times; the trainer starts another game, or ends with a named error."""
    the_round.choose_engine(*GAMES)
    lies = [_draw(the_round) for _ in range(the_round.chance.choice([1, 1, 2, 3]))]
    for lie in lies:
        the_round.decide(str(lie))
    the_round.counts["lies"] += len(lies)
    trainer = the_round.begin(before=lambda: plant_proxy(lies))
    check_ending(trainer)
    check_all(the_round)


def _draw(the_round: Round) -> Lie:
    chance = the_round.chance
    to_trainer, kind = chance.random() < 0.6, chance.choice(KINDS)
    # The greeting takes the first kilobytes, and a step a hundred bytes.
    at = chance.choice([chance.randrange(64), chance.randrange(2000), chance.randrange(12_000)])
    value = {
        "delay": chance.uniform(0.0, 1.5 * STEP_TIMEOUT_S),
        "cut": None,
        "flip": 1 << chance.randrange(8),
        "insert": chance.randbytes(chance.choice([1, 8, 300])),
        "drop": chance.choice([1, 8, 100]),
    }[kind]
    return Lie(to_trainer, at, kind, value)
