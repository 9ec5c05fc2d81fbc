"""Where two recordings first differ, to the bit."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ludus.check.recording import Frame, Recording, named_arrays
from ludus.spec import Spec
from ludus.spec.batch import Batch

__all__ = ["Difference", "first_difference", "frame_difference", "standing_difference"]

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
        """Say it in one sentence; ``first`` and ``second`` name the two runs."""
        index = "".join(f"[{i}]" for i in self.element)
        one, two = self.values
        return (
            f"step {self.step} (tick {self.tick}), world {self.world}, agent {self.agent}: "
            f"{self.policy}.{self.what}{index} is {one:.9g} ({first}) and {two:.9g} ({second})"
        )

    def to_json(self) -> dict[str, Any]:
        """Return the difference as JSON values."""
        return {
            "step": self.step,
            "tick": self.tick,
            "policy": self.policy,
            "what": self.what,
            "slot": self.slot,
            "world": self.world,
            "agent": self.agent,
            "element": list(self.element),
            "values": list(self.values),
        }


def first_difference(one: Recording, two: Recording) -> Difference | None:
    """Return the first difference of two recordings of equal games, or None."""
    start = one.frames[0].tick
    for step, (first, second) in enumerate(zip(one.frames, two.frames, strict=False)):
        found = frame_difference(one.spec, first.batches, second.batches, step, first.tick - start)
        if found is not None:
            return found
    return None


def standing_difference(
    spec: Spec, one: Mapping[str, Batch], two: Mapping[str, Batch], worlds: Iterable[int]
) -> Difference | None:
    """Return the first difference between where the agents of some worlds stand, or None.

    Observations, activity and masks count; outcomes of the last step do not.
    """
    first = Recording(spec, 0, (Frame(0, dict(one)),))
    second = Recording(spec, 0, (Frame(0, dict(two)),))
    for world in worlds:
        own, other = first.world(world), second.world(world)
        found = frame_difference(
            own.spec, own.frames[0].batches, other.frames[0].batches, is_standing_only=True
        )
        if found is not None:
            return found
    return None


def frame_difference(
    spec: Spec,
    one: Mapping[str, Batch],
    two: Mapping[str, Batch],
    step: int = 0,
    tick: int = 0,
    *,
    is_standing_only: bool = False,
) -> Difference | None:
    """Return the first number that is not the same in two answers, or None.

    With ``is_standing_only`` the outcomes of the last step do not count.
    """
    for policy in spec.policies:
        pairs = zip(named_arrays(one[policy.name]), named_arrays(two[policy.name]), strict=True)
        for (what, first), (_, second) in pairs:
            if is_standing_only and not what.startswith(_STANDING):
                continue
            place = _first_place(first, second)
            if place is None:
                continue
            slot = place[0] if len(place) else -1
            agent = policy.agents[slot] if slot >= 0 else None
            return Difference(
                step=step,
                tick=tick,
                policy=policy.name,
                what=what,
                slot=slot,
                world=-1 if agent is None else agent.world,
                agent="?" if agent is None else agent.path or "(joined later)",
                element=place[1:],
                values=(_number(first, place), _number(second, place)),
            )
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


def _number(values: NDArray[Any], place: tuple[int, ...]) -> float:
    return float(values[place]) if place else float(len(values))
