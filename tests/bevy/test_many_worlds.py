"""Sixteen thousand worlds in one engine play as a few do."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from ludus.errors import ProtocolError
from ludus.session import EngineSession
from ludus.spec.batch import ActionBatch, Batch
from ludus.wire.reset import ResetRequest
from tests.bevy.conftest import Open

pytestmark = [pytest.mark.engine, pytest.mark.bevy, pytest.mark.timeout(180, func_only=True)]

NUM_WORLDS = 16_384
NUM_COMPARED = 8


def reset(session: EngineSession) -> Batch:
    return session.reset(ResetRequest.all_worlds(session.spec.num_worlds, seed=5))["cart"]


def step(session: EngineSession, choices: NDArray[np.int64]) -> Batch:
    numbers = np.zeros((len(choices), 0), np.float32)
    session.send({"cart": ActionBatch(choices[:, None], numbers)})
    return session.receive()["cart"]


def outcome(batch: Batch, first: int) -> list[NDArray[np.generic]]:
    """Return copies of all that `NUM_COMPARED` slots from `first` on were told."""
    slots = slice(first, first + NUM_COMPARED)
    is_final = (batch.final_index >= slots.start) & (batch.final_index < slots.stop)
    return [
        batch.observation["observation"][slots].copy(),
        batch.reward[slots].copy(),
        batch.terminated[slots].copy(),
        batch.truncated[slots].copy(),
        batch.active[slots].copy(),
        batch.final_index[is_final] - first,
        batch.final_observation["observation"][is_final].copy(),
    ]


@pytest.mark.parametrize("first", [0, NUM_WORLDS - NUM_COMPARED])
def test_each_world_plays_as_in_a_small_engine(open_game: Open, first: int) -> None:
    many = open_game(num_worlds=NUM_WORLDS)
    few = open_game(num_worlds=NUM_COMPARED, first_world=first)
    seeds = np.arange(first, first + NUM_COMPARED, dtype=np.uint64) + np.uint64(5)
    batch = few.reset(ResetRequest(seeds, np.full(NUM_COMPARED, 2, np.uint8)))["cart"]
    few_told = [outcome(batch, 0)]
    many_told = [outcome(reset(many), first)]
    rng = np.random.default_rng(1)
    for _ in range(60):
        choices = rng.integers(0, 2, NUM_WORLDS)
        many_told.append(outcome(step(many, choices), first))
        few_told.append(outcome(step(few, choices[first : first + NUM_COMPARED]), 0))
    assert sum(len(told[5]) for told in few_told) > NUM_COMPARED, "episodes end and begin"
    for one, other in zip(many_told, few_told, strict=True):
        for left, right in zip(one, other, strict=True):
            np.testing.assert_array_equal(left, right)


@pytest.mark.parametrize("choice", [2, -1, 2**62])
def test_a_wrong_choice_of_the_last_slot_is_named(open_game: Open, choice: int) -> None:
    session = open_game(num_worlds=NUM_WORLDS)
    reset(session)
    choices = np.zeros(NUM_WORLDS, np.int64)
    choices[-1] = choice
    with pytest.raises(ProtocolError, match=rf"slot 16383, action push.*got {choice}"):
        step(session, choices)
