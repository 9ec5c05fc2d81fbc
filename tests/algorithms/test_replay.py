from __future__ import annotations

from collections import deque
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from ludus.algorithms.replay import Replay, transitions
from ludus.algorithms.rollout import SlotState
from ludus.errors import CheckpointError
from ludus.networks.tensors import to_numbers
from ludus.spec import AgentSpec, DiscreteAction, ObservationEntry, PolicySpec
from ludus.spec.batch import Batch

NUM_SLOTS = 3
SPEC = PolicySpec(
    "hero",
    (ObservationEntry("o", "float32", (2,)), ObservationEntry("image", "uint8", (3, 3, 1))),
    (DiscreteAction("a", 4),),
    tuple(AgentSpec(world, "x") for world in range(NUM_SLOTS)),
    has_action_mask=True,
)


def batch(random: np.random.Generator, **changes: Any) -> Batch:
    result = Batch.allocate(SPEC, NUM_SLOTS)
    result.observation["o"][:] = random.normal(size=(NUM_SLOTS, 2))
    result.observation["image"][:] = random.integers(256, size=(NUM_SLOTS, 3, 3, 1))
    result.reward[:] = random.normal(size=NUM_SLOTS)
    result.active[:] = True
    result.action_mask = random.random((NUM_SLOTS, 4)) < 0.5
    return replace(result, **changes)


def finals(random: np.random.Generator, index: list[int]) -> dict[str, Any]:
    return {
        "final_index": np.asarray(index, np.int64),
        "final_observation": {
            "o": random.normal(size=(len(index), 2)).astype(np.float32),
            "image": random.integers(256, size=(len(index), 3, 3, 1)).astype(np.uint8),
        },
    }


def step(replay: Replay, last: SlotState, now: Batch, action: Any) -> int:
    last.discrete[:, 0] = action
    added = replay.add(transitions(last, now))
    last.write_state(now)
    return added


def rows(replay: Replay) -> list[dict[str, Any]]:
    """Return all transitions, oldest first."""
    state = replay.state()
    position, size, _ = (int(value) for value in state.pop("position"))
    order = [(position + index) % size for index in range(size)]
    if size < replay.capacity:
        order = list(range(size))
    return [{name: tensor[index].numpy() for name, tensor in state.items()} for index in order]


def random_outcome(random: np.random.Generator) -> Batch:
    """Return a batch in which anything may have happened."""
    ended = random.random(NUM_SLOTS) < 0.4
    terminated = ended & (random.random(NUM_SLOTS) < 0.5)
    changes: dict[str, Any] = {
        "terminated": terminated,
        "truncated": ended & ~terminated,
        "active": random.random(NUM_SLOTS) < 0.8,
    }
    is_final = ended & (random.random(NUM_SLOTS) < 0.7)
    return batch(random, **changes, **finals(random, is_final.nonzero()[0].tolist()))


def expected(last: SlotState, now: Batch, slot: int) -> dict[str, Any] | None:
    """Return the transition of a slot as the text of ``transitions`` has it; None for none."""
    is_final = slot in now.final_index
    is_truncated = now.truncated[slot] and not now.terminated[slot]
    if not last.is_active[slot] or (is_truncated and not is_final):
        return None
    row = int(np.searchsorted(now.final_index, slot))
    assert now.action_mask is not None
    result: dict[str, Any] = {
        "discrete": last.discrete[slot],
        "reward": now.reward[slot],
        "is_terminated": now.terminated[slot] or not (now.active[slot] or is_truncated),
        "mask": last.mask[slot],
        "next_mask": last.mask[slot] if is_truncated else now.action_mask[slot],
    }
    for name in ("o", "image"):
        result[f"observation.{name}"] = last.observation[name][slot]
        seen = now.final_observation[name][row] if is_final else now.observation[name][slot]
        result[f"next_observation.{name}"] = seen
    return {name: np.copy(value) for name, value in result.items()}


@pytest.mark.parametrize("capacity", [2, 7, 1000])
def test_holds_the_newest_transitions_of_active_slots(capacity: int) -> None:
    """Anything may end, fall silent or vanish; a plain deque says what must be there."""
    random = np.random.default_rng(capacity)
    replay, last = Replay(SPEC, capacity), SlotState.allocate(SPEC, NUM_SLOTS)
    reference: deque[dict[str, Any]] = deque(maxlen=capacity)
    last.write_state(batch(random))
    for _ in range(60):
        now, action = random_outcome(random), random.integers(4, size=NUM_SLOTS)
        last.discrete[:, 0] = action
        wanted = [expected(last, now, slot) for slot in range(NUM_SLOTS)]
        kept = [each for each in wanted if each is not None]
        reference.extend(kept)
        assert step(replay, last, now, action) == len(kept)
    assert replay.size == len(reference)
    for mine, theirs in zip(rows(replay), reference, strict=True):
        for name, value in theirs.items():
            np.testing.assert_array_equal(mine[name], value, err_msg=name)


def test_transitions_at_the_end_of_episodes() -> None:
    """Slot 0 is truncated, slot 1 dies, slot 2 falls silent."""
    random = np.random.default_rng(0)
    replay, last = Replay(SPEC, 10), SlotState.allocate(SPEC, NUM_SLOTS)
    first = batch(random)
    last.write_state(first)
    final = finals(random, [0, 1])
    now = batch(
        random, truncated=np.array([True, False, False]), terminated=np.array([False, True, False]),
        active=np.array([True, True, False]), **final,
    )  # fmt: skip
    assert step(replay, last, now, [1, 2, 3]) == 3
    of_0, of_1, of_2 = rows(replay)
    assert [bool(row["is_terminated"]) for row in (of_0, of_1, of_2)] == [False, True, True]
    np.testing.assert_array_equal(of_0["next_observation.o"], final["final_observation"]["o"][0])
    np.testing.assert_array_equal(of_0["observation.image"], first.observation["image"][0])
    assert step(replay, last, batch(random), [0, 0, 0]) == 2  # the silent slot did nothing
    np.testing.assert_array_equal(rows(replay)[3]["observation.o"], now.observation["o"][0])


def test_a_vanished_engine_leaves_no_transition() -> None:
    random = np.random.default_rng(0)
    replay, last = Replay(SPEC, 10), SlotState.allocate(SPEC, NUM_SLOTS)
    last.write_state(batch(random))
    assert step(replay, last, batch(random, truncated=np.ones(NUM_SLOTS, np.bool_)), 0) == 0
    assert replay.size == 0


def filled(seed: int, capacity: int = 20, steps: int = 9) -> tuple[Replay, SlotState]:
    random = np.random.default_rng(seed)
    replay, last = Replay(SPEC, capacity), SlotState.allocate(SPEC, NUM_SLOTS)
    last.write_state(batch(random))
    for _ in range(steps):
        step(replay, last, batch(random), random.integers(4, size=NUM_SLOTS))
    return replay, last


def test_samples_are_whole_rows_drawn_uniformly() -> None:
    replay, _ = filled(0)
    sample = replay.sample(4000, torch.Generator().manual_seed(1), torch.device("cpu"))
    assert sample.observation["image"].dtype == torch.uint8
    rewards = {float(row["reward"]): row for row in rows(replay)}
    counts = dict.fromkeys(rewards, 0)
    assert sample.mask is not None
    for index, reward in enumerate(to_numbers(sample.reward)):
        row = rewards[reward]
        counts[reward] += 1
        np.testing.assert_array_equal(sample.observation["o"][index], row["observation.o"])
        np.testing.assert_array_equal(sample.discrete[index], row["discrete"])
        np.testing.assert_array_equal(sample.mask[index], row["mask"])
    assert len(counts) == 20
    assert all(120 < count < 290 for count in counts.values())  # 200 expected, deviation 14


def test_newest_end_with_the_last_transition() -> None:
    replay, _ = filled(0)
    newest = replay.newest(5)["o"].numpy()
    np.testing.assert_array_equal(newest, [row["observation.o"] for row in rows(replay)[-5:]])
    assert len(replay.newest(100)["o"]) == 20


@pytest.mark.parametrize("steps", [2, 9])
def test_a_restored_replay_continues_as_before(steps: int) -> None:
    one, last = filled(0, steps=steps)
    two = Replay(SPEC, 20)
    two.load_state(one.state())
    random = np.random.default_rng(5)
    for _ in range(5):
        now = batch(random)
        one.add(transitions(last, now))
        two.add(transitions(last, now))
    first, second = one.state(), two.state()
    assert first.keys() == second.keys()
    assert all(torch.equal(first[name], second[name]) for name in first)
    assert len(first["reward"]) == min(20, 3 * (steps + 5))


def test_a_state_holds_only_what_is_filled_and_no_views() -> None:
    replay, last = filled(0, capacity=1000, steps=2)
    state = replay.state()
    assert len(state["observation.o"]) == 6
    before = state["reward"].clone()
    replay.add(transitions(last, batch(np.random.default_rng(1))))
    assert torch.equal(state["reward"], before)


def test_another_capacity_is_refused() -> None:
    replay, _ = filled(0)
    with pytest.raises(CheckpointError, match="replay of the checkpoint does not fit"):
        Replay(SPEC, 21).load_state(replay.state())
