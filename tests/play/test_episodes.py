from __future__ import annotations

import numpy as np

from ludus.play.episodes import EpisodeCounter, EpisodeTracker
from ludus.spec import AgentSpec, PolicySpec
from ludus.spec.batch import Batch

SPEC = PolicySpec("p", (), (), (AgentSpec(0, "a"),) * 3)


def batch(reward: list[float], ended: list[int], active: list[int]) -> Batch:
    result = Batch.allocate(SPEC, 3)
    result.reward[:] = reward
    result.terminated[:] = np.asarray(ended, np.bool_)
    result.active[:] = np.asarray(active, np.bool_)
    return result


def test_counts_only_what_active_slots_did() -> None:
    tracker, rows = EpisodeTracker(3, window=10), slice(0, 3)
    tracker.begin(rows, batch([0, 0, 0], [0, 0, 0], [1, 1, 0]))
    # Slot 2 was silent: neither its reward nor its end count. It joins now; slot 1 goes.
    ended = tracker.record(rows, batch([1, 2, 100], [0, 1, 1], [1, 0, 1]))
    assert ended.slots.tolist() == [1]
    ended = tracker.record(rows, batch([1, 50, 4], [1, 0, 1], [1, 1, 1]))
    assert ended.slots.tolist() == [0, 2]
    assert (ended.returns.tolist(), ended.lengths.tolist()) == ([2.0, 4.0], [2, 1])
    assert list(tracker.returns) == [2.0, 2.0, 4.0]
    assert list(tracker.lengths) == [1, 2, 1]
    assert (tracker.num_episodes, tracker.num_steps) == (3, 4)


def test_rows_of_one_engine() -> None:
    tracker = EpisodeTracker(6, window=10)
    tracker.begin(slice(3, 6), batch([0, 0, 0], [0, 0, 0], [1, 1, 1]))
    ended = tracker.record(slice(3, 6), batch([1, 2, 3], [0, 0, 1], [1, 1, 1]))
    assert ended.slots.tolist() == [2]
    assert list(tracker.returns) == [3.0]


def test_window_and_state() -> None:
    tracker, rows = EpisodeTracker(3, window=2), slice(0, 3)
    tracker.begin(rows, batch([0, 0, 0], [0, 0, 0], [1, 1, 1]))
    tracker.record(rows, batch([1, 2, 3], [1, 1, 1], [1, 1, 1]))
    assert list(tracker.returns) == [2.0, 3.0]
    other = EpisodeTracker(3, window=2)
    other.load_state(tracker.state())
    assert other.summary() == tracker.summary()
    assert other.num_episodes == 3


def test_a_tracker_without_a_window_keeps_every_episode() -> None:
    tracker, rows = EpisodeTracker(3, window=None), slice(0, 3)
    tracker.begin(rows, batch([0, 0, 0], [0, 0, 0], [1, 1, 1]))
    for _ in range(40):
        tracker.record(rows, batch([1, 2, 3], [1, 1, 1], [1, 1, 1]))
    assert len(tracker.returns) == len(tracker.lengths) == 120


def test_a_counter_is_complete_when_every_policy_has_had_enough() -> None:
    heard: list[tuple[str, int, float, int]] = []

    def hear(policy: str, number: int, episode_return: float, length: int) -> None:
        heard.append((policy, number, episode_return, length))

    counter = EpisodeCounter(["hero", "foe"], 2, hear)
    for value in (1.0, 2.0, 3.0):
        counter.add("hero", value, 7)
    counter.add("extra", 9.0, 1)
    counter.add("foe", 4.0, 5)
    assert not counter.is_complete
    counter.add("foe", 5.0, 5)
    assert counter.is_complete
    # The third episode of the hero counts, but is not told of.
    assert counter.num_episodes == {"hero": 3, "extra": 1, "foe": 2}
    assert heard == [
        ("hero", 1, 1.0, 7), ("hero", 2, 2.0, 7), ("extra", 1, 9.0, 1),
        ("foe", 1, 4.0, 5), ("foe", 2, 5.0, 5),
    ]  # fmt: skip


def test_a_counter_without_a_number_is_never_complete() -> None:
    counter = EpisodeCounter(["hero"], None)
    counter.add("hero", 1.0, 1)
    assert not counter.is_complete
