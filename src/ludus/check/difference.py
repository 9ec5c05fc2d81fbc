"""The first bit in which two recordings differ."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ludus.check.recording import Recording, named_arrays
from ludus.spec import Spec
from ludus.spec.batch import Batch

__all__ = ["Difference", "first_difference", "standing_difference"]

_STANDING = ("observation", "active", "action_mask")


@dataclass(frozen=True)
class Difference:
    """The first number that is not the same in two runs.

    Attributes:
        step: Steps since the reset; 0 is the answer to the reset itself.
        tick: Ticks since the reset.
        policy: Policy name.
        what: Which array, for example ``observation["rays"]``.
        slot: Which agent of the policy, -1 if the arrays differ in length.
        world: Its world, -1 if the arrays differ in length.
        agent: Its path in the world.
        element: Index in the agent's part of the array.
        values: The number in the first and in the second run.
    """

    step: int
    tick: int
    policy: str
    what: str
    slot: int
    world: int
    agent: str
    element: tuple[int, ...]
    values: tuple[float, float]

    def describe(self, first: str = "first", second: str = "second") -> str:
        """Describe the difference; ``first`` and ``second`` name the two runs."""
        index = "".join(f"[{i}]" for i in self.element)
        one, two = self.values
        return (
            f"step {self.step} (tick {self.tick}), world {self.world}, agent {self.agent}: "
            f"{self.policy}.{self.what}{index} is {one:.9g} ({first}) and {two:.9g} ({second})"
        )

    def to_json(self) -> dict[str, Any]:
        """Return the difference as JSON values."""
        return {**asdict(self), "element": list(self.element), "values": list(self.values)}


def first_difference(one: Recording, two: Recording) -> Difference | None:
    """Return the first difference between two recordings of one game; None if there is none."""
    start = one.frames[0].tick
    for step, (first, second) in enumerate(zip(one.frames, two.frames, strict=False)):
        found = _frame_difference(one.spec, first.batches, second.batches)
        if found is not None:
            return replace(found, step=step, tick=first.tick - start)
    return None


def standing_difference(
    spec: Spec, one: Mapping[str, Batch], two: Mapping[str, Batch], first_world: int = 0
) -> Difference | None:
    """Return the first difference in the state of the worlds from ``first_world`` on, or None.

    Observations, activity and masks are compared; outcomes of the last step are not.
    """
    return _frame_difference(spec, one, two, first_world, _STANDING)


def _frame_difference(
    spec: Spec,
    one: Mapping[str, Batch],
    two: Mapping[str, Batch],
    first_world: int = 0,
    prefixes: tuple[str, ...] = ("",),
) -> Difference | None:
    """Compare the arrays whose names begin with one of ``prefixes``."""
    for policy in spec.policies:
        skipped = first_world * policy.agents_per_world
        pairs = zip(named_arrays(one[policy.name]), named_arrays(two[policy.name]), strict=True)
        for (what, first), (_, second) in pairs:
            if not what.startswith(prefixes):
                continue
            place = _first_place(first[skipped:], second[skipped:])
            if place is None:
                continue
            if not place:
                lengths = (float(len(first)), float(len(second)))
                return Difference(0, 0, policy.name, what, -1, -1, "?", (), lengths)
            slot, *element = place[0] + skipped, *place[1:]
            agent = policy.agents[slot]
            path = agent.path or "(joined later)"
            values = (float(first[(slot, *element)]), float(second[(slot, *element)]))
            world = agent.world
            return Difference(0, 0, policy.name, what, slot, world, path, tuple(element), values)
    return None


def _first_place(one: NDArray[Any], two: NDArray[Any]) -> tuple[int, ...] | None:
    """Return the index of the first element whose bits differ; empty if the shapes do."""
    if one.shape != two.shape:
        return ()
    if one.tobytes() == two.tobytes():
        return None
    bits = np.dtype(f"u{one.dtype.itemsize}")
    unequal = np.ascontiguousarray(one).view(bits) != np.ascontiguousarray(two).view(bits)
    return tuple(int(i) for i in np.argwhere(unequal)[0])
