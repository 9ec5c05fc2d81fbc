"""The last observations of an episode lie side by side, and of no other episode."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ludus.model.frame_stack import FrameStack
from ludus.model.policy_model import is_image, stack_entries
from ludus.spec import AgentSpec, DiscreteAction, ObservationEntry, PolicySpec
from ludus.spec.batch import Batch

ENTRIES = (
    ObservationEntry("place", "float32", (2,), (-1.0, -2.0), (1.0, 2.0)),
    ObservationEntry("eye", "uint8", (4, 5, 3)),
    ObservationEntry("table", "uint8", (2, 3)),
)
SPEC = PolicySpec("hero", ENTRIES, (DiscreteAction("a", 2),), (AgentSpec(0, None),))


def batch(*values: int, ended: tuple[int, ...] = (), final: int = 0) -> Batch:
    """Return what slots observe, everywhere the same number in each."""
    made = Batch.allocate(SPEC, len(values))
    made.active[...] = True
    for array in made.observation.values():
        array[...] = np.reshape(values, (-1, *[1] * (array.ndim - 1)))
    made.truncated[list(ended)] = True
    made.final_index = np.array(ended, np.int64)
    made.final_observation = {
        entry.name: np.full((len(ended), *entry.shape), final, entry.numpy_dtype)
        for entry in ENTRIES
    }
    return made


def seen(observation: dict[str, NDArray[Any]], slot: int) -> list[int]:
    """Return the number of each frame, which all elements of all entries agree on."""
    frames = [observation[name][slot].reshape(3, -1) for name in ("place", "eye", "table")]
    joined = np.concatenate([part.astype(np.int64) for part in frames], 1)
    assert (joined == joined[:, :1]).all()
    return joined[:, 0].tolist()


def test_entries_get_one_more_axis_and_tables_never_become_images() -> None:
    place, eye, table = stack_entries(ENTRIES, 3)
    assert (place.shape, eye.shape, table.shape) == ((3, 2), (3, 4, 5, 3), (3, 6))
    assert place.bounds()[0].tolist() == [[-1.0, -2.0]] * 3
    assert (is_image(eye), is_image(table)) == (True, False)
    assert stack_entries(ENTRIES, 1) == ENTRIES


def test_the_first_observation_takes_the_missing_places() -> None:
    stack = FrameStack(ENTRIES, 3, 2)
    assert [seen(stack.push_batch(batch(1, 5)).observation, slot) for slot in (0, 1)] == [
        [1, 1, 1], [5, 5, 5],
    ]  # fmt: skip
    assert seen(stack.push_batch(batch(2, 6)).observation, 0) == [1, 1, 2]
    assert seen(stack.push_batch(batch(3, 7)).observation, 1) == [5, 6, 7]
    assert seen(stack.push_batch(batch(4, 8)).observation, 0) == [2, 3, 4]


def test_the_end_of_an_episode_is_seen_with_what_came_before() -> None:
    stack = FrameStack(ENTRIES, 3, 2)
    stack.push_batch(batch(1, 5))
    stack.push_batch(batch(2, 6))
    after = stack.push_batch(batch(9, 7, ended=(0,), final=3))
    assert seen(after.final_observation, 0) == [1, 2, 3]
    assert [seen(after.observation, slot) for slot in (0, 1)] == [[9, 9, 9], [5, 6, 7]]


def test_a_slot_that_was_empty_begins_anew() -> None:
    stack = FrameStack(ENTRIES, 3, 2)
    first = batch(1, 5)
    first.active[1] = False
    stack.push_batch(first)
    assert seen(stack.push_batch(batch(2, 6)).observation, 1) == [6, 6, 6]
    stack.forget(np.array([0]))
    after = stack.push_batch(batch(3, 7)).observation
    assert [seen(after, slot) for slot in (0, 1)] == [[3, 3, 3], [6, 6, 7]]


def test_one_frame_is_the_observation_itself() -> None:
    given = batch(1, 5)
    assert FrameStack(ENTRIES, 1, 2).push_batch(given) is given
