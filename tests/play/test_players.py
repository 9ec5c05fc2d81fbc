"""A policy file plays as the run it came from, whatever becomes of its agents."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from ludus.export.convert import to_model
from ludus.model import ModelRunner
from ludus.networks.policy import Player
from ludus.play.players import FilePlayer
from ludus.spec import ContinuousAction, PolicySpec
from ludus.spec.batch import Batch
from tests.export.trained_runs import SIMPLE, SMALL, make_policy

NUM = 5
SPEC = dataclasses.replace(SIMPLE, action=(ContinuousAction("aim", 2),))
CONFIGS = {
    "memory": dataclasses.replace(SMALL, memory_size=6),
    "frames": dataclasses.replace(SMALL, frame_stack=3),
    "both": dataclasses.replace(SMALL, memory_size=6, frame_stack=2),
}


def make_players(case: str, num_slots: int = NUM) -> tuple[FilePlayer, Player]:
    policy = make_policy(SPEC, CONFIGS[case])
    return FilePlayer(ModelRunner(to_model(policy, SPEC)), num_slots), Player(policy, num_slots)


def draw_batch(rng: np.random.Generator, was_active: np.ndarray, spec: PolicySpec = SPEC) -> Batch:
    """Return a batch in which some agents end, and some slots are empty or filled again."""
    batch = Batch.allocate(spec, NUM)
    for entry in spec.observation:
        batch.observation[entry.name][...] = rng.normal(size=(NUM, *entry.shape))
    batch.active[...] = rng.random(NUM) < 0.8
    batch.terminated[...] = was_active & (rng.random(NUM) < 0.2)
    batch.truncated[...] = was_active & ~batch.terminated & (rng.random(NUM) < 0.1)
    batch.final_index = np.flatnonzero(batch.terminated | batch.truncated)
    batch.final_observation = {
        name: values[batch.final_index] for name, values in batch.observation.items()
    }
    return batch


@pytest.mark.parametrize("case", CONFIGS)
def test_a_file_forgets_where_its_run_does(case: str) -> None:
    file, run = make_players(case)
    rng = np.random.default_rng(3)
    active = np.zeros(NUM, np.bool_)
    for _ in range(60):
        if rng.random() < 0.2:
            reset = np.flatnonzero(rng.random(NUM) < 0.5)
            file.forget(reset)
            run.forget(reset)
        batch = draw_batch(rng, active)
        active = batch.active
        np.testing.assert_allclose(
            file.act(batch).continuous[active], run.act(batch).continuous[active], atol=1e-5
        )


@pytest.mark.parametrize("case", CONFIGS)
def test_a_slot_that_was_told_of_a_reset_begins_anew(case: str) -> None:
    file, _ = make_players(case)
    file.forget(np.arange(NUM))  # before the first batch there is nothing to forget
    rng = np.random.default_rng(3)
    first, second = (draw_batch(rng, np.zeros(NUM, np.bool_)) for _ in range(2))
    first.active[...] = second.active[...] = True
    file.act(first)
    file.forget(np.array([0, 2]))
    after = file.act(second).continuous
    fresh = make_players(case)[0].act(second).continuous
    is_equal = np.isclose(after, fresh, atol=1e-6).all(1)
    assert is_equal.tolist() == [True, False, True, False, False]
