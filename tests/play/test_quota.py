from __future__ import annotations

import numpy as np
import pytest

from ludus.play.quota import Quota
from ludus.spec import AgentSpec, DiscreteAction, ObservationEntry, PolicySpec
from ludus.spec.batch import Batch


def first_batch(*active: bool) -> Batch:
    entry, action = ObservationEntry("x", "float32", (1,)), DiscreteAction("x", 2)
    spec = PolicySpec("agent", (entry,), (action,), (AgentSpec(0, "agent"),) * len(active))
    batch = Batch.allocate(spec, len(active))
    batch.active[:] = active
    return batch


def take(quota: Quota, *slots: int) -> list[bool]:
    return quota.take(np.array(slots, np.int64)).tolist()


@pytest.mark.parametrize(("num_episodes", "of_each"), [(5, (3, 0, 2)), (1, (1, 0, 0))])
def test_active_slots_share_the_episodes(num_episodes: int, of_each: tuple[int, ...]) -> None:
    quota = Quota(first_batch(True, False, True), num_episodes)
    taken = np.zeros(3, np.int64)
    for _ in range(4):
        taken += take(quota, 0, 1, 2)
    assert tuple(taken) == of_each
    assert quota.is_met


def test_a_slot_is_wanted_until_it_has_had_its_share() -> None:
    quota = Quota(first_batch(True, False, True), 2)
    assert [quota.wants(slot) for slot in range(3)] == [True, False, True]
    assert take(quota, 0, 1) == [True, False]
    assert [quota.wants(slot) for slot in range(3)] == [False, False, True]
    assert not quota.is_met


def test_any_slot_counts_where_none_is_active() -> None:
    quota = Quota(first_batch(False, False, False), 3)
    assert take(quota, 1) == [True]
    assert [quota.wants(slot) for slot in range(3)] == [True] * 3
    assert take(quota, 0, 1, 2) == [True, True, False]
    assert [quota.wants(slot) for slot in range(3)] == [False] * 3
    assert quota.is_met


def test_without_a_number_each_active_slot_counts_once() -> None:
    quota = Quota(first_batch(False, True, True))
    assert take(quota, 0, 1, 2) == [False, True, True]
    assert quota.is_met
    assert Quota(first_batch(False)).is_met
