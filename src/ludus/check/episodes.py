"""Do two recordings show the same episodes, up to rounding and the chaos that grows from it?

Copies in a grid have other coordinates and are solved in another order, so their numbers differ in
the last bits, and a chaotic game drifts apart from there. Games that really differ show it in the
first observation or the first step, jump apart within one step in many worlds, or have episodes of
other lengths or returns.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ludus.check.difference import Difference, first_difference
from ludus.check.numbers import differences, largest_difference, scales
from ludus.check.recording import Recording
from ludus.play.episodes import EpisodeTracker

__all__ = ["Comparison", "Verdict", "compare_episodes"]

FIRST_TOLERANCE = 1e-3
"""For the first observation, in units of the element's usual size."""
STEP_TOLERANCE = 2e-2
"""For the first step; rounding errors are still small then."""
DIVERGED = 5e-2
JUMP_FROM = 1e-4
"""A world that was this close and has diverged one step later has jumped."""
MAX_JUMPING_SHARE = 0.25
MAX_STANDARD_ERRORS = 5.0
MIN_EPISODES = 8


class Verdict(StrEnum):
    """How alike two recordings are."""

    EQUAL = "equal to the bit"
    CLOSE = "close"
    DIFFERENT = "different"


@dataclass(frozen=True)
class Comparison:
    """Two recordings of the same seeds and actions.

    Attributes:
        verdict: How alike they are.
        reason: Why they count as different, or how close they are.
        difference: The first number that is not equal to the bit.
        close_steps: Steps until the first world has diverged.
        largest: Largest difference until then, in units of the elements' usual size.
    """

    verdict: Verdict
    reason: str
    difference: Difference | None
    close_steps: int
    largest: float

    def describe(self) -> str:
        """Describe the result in one sentence."""
        if self.verdict is Verdict.EQUAL:
            return str(self.verdict)
        return f"{self.verdict}: {self.reason}"

    def to_json(self) -> dict[str, Any]:
        """Return the comparison as JSON values."""
        return {
            "verdict": str(self.verdict),
            "reason": self.reason,
            "close_steps": self.close_steps,
            "largest_difference": self.largest,
            "difference": None if self.difference is None else self.difference.to_json(),
        }


def compare_episodes(isolated: Recording, grid: Recording) -> Comparison:
    """Compare recordings of the same seeds and actions in the two layouts."""
    found = first_difference(isolated, grid)
    num_steps = min(isolated.num_steps, grid.num_steps)
    if found is None:
        return Comparison(Verdict.EQUAL, "", None, num_steps, 0.0)
    drift = _Drift(isolated, grid)
    close_steps, largest = drift.horizon()
    reason = drift.early_difference() or drift.jumps() or _other_statistics(isolated, grid)
    if reason:
        reason += f"; first differing bit: {found.describe('isolated', 'grid')}"
        return Comparison(Verdict.DIFFERENT, reason, found, close_steps, largest)
    reason = f"the largest difference is {largest:.1g} of the usual size"
    if close_steps < num_steps:
        reason += f" up to step {close_steps}; rounding errors grow after it"
    return Comparison(Verdict.CLOSE, reason, found, close_steps, largest)


class _Drift:
    """The distance of each world from its twin in the other layout, step by step.

    ``size`` is ``float64[num_steps + 1, num_worlds]`` in units of each element's usual size. It is
    infinite where an episode ended in one layout only.
    """

    def __init__(self, isolated: Recording, grid: Recording) -> None:
        self._isolated, self._grid = isolated, grid
        self._scale = scales(isolated)
        num_worlds = isolated.spec.num_worlds
        pairs = zip(isolated.frames, grid.frames, strict=False)
        self.size = np.zeros((min(len(isolated.frames), len(grid.frames)), num_worlds))
        for step, (one, two) in enumerate(pairs):
            for policy in isolated.spec.policies:
                size = differences(policy, one.batches, two.batches, self._scale).max(axis=1)
                first, second = one.batches[policy.name], two.batches[policy.name]
                has_ended = first.terminated | first.truncated
                size[has_ended != (second.terminated | second.truncated)] = np.inf
                by_world = size.reshape(num_worlds, -1).max(axis=1)
                self.size[step] = np.maximum(self.size[step], by_world)

    def horizon(self) -> tuple[int, float]:
        """Return the steps until a world has diverged, and the largest difference until then."""
        diverged = (self.size > DIVERGED).any(axis=1)
        steps = int(diverged.argmax()) if diverged.any() else len(self.size)
        return max(0, steps - 1), float(self.size[:steps].max(initial=0.0))

    def early_difference(self) -> str:
        """Describe a difference in the first observation or step that rounding cannot explain."""
        for step, tolerance in ((0, FIRST_TOLERANCE), (1, STEP_TOLERANCE)):
            if step < len(self.size) and (self.size[step] > tolerance).any():
                world = int(self.size[step].argmax())
                when = "the first observation" if step == 0 else "the first step"
                return f"{when} of world {world} differs: {self._largest(step, world)}"
        return ""

    def jumps(self) -> str:
        """Describe where many worlds jump apart within one step, if they do."""
        was_close = np.maximum.accumulate(self.size, axis=0)[:-1] <= JUMP_FROM
        jumped = was_close & (self.size[1:] > DIVERGED)
        worlds = np.flatnonzero(jumped.any(axis=0))
        if len(worlds) <= MAX_JUMPING_SHARE * self.size.shape[1]:
            return ""
        steps = jumped[:, worlds].argmax(axis=0) + 1
        world, step = int(worlds[steps.argmin()]), int(steps.min())
        return (
            f"{len(worlds)} of {self.size.shape[1]} worlds jump apart in one step, world {world} "
            f"at step {step}: {self._largest(step, world)}"
        )

    def _largest(self, step: int, world: int) -> str:
        one, two = (recording.frames[step].batches for recording in (self._isolated, self._grid))
        found = largest_difference(self._isolated.spec, one, two, self._scale, world)
        if found is None or np.isinf(self.size[step, world]):
            return "an episode ended in one layout only"
        isolated, grid = found.values
        return f"{found.name} is {isolated:.6g} isolated and {grid:.6g} in the grid"


def _other_statistics(isolated: Recording, grid: Recording) -> str:
    """Describe a difference in the mean length or return of episodes that chance cannot explain."""
    for name in (policy.name for policy in isolated.spec.policies):
        one, two = _episodes(isolated, name), _episodes(grid, name)
        for what, a, b in zip(("length", "return"), one, two, strict=True):
            if min(len(a), len(b)) < MIN_EPISODES:
                continue
            error = np.sqrt(a.var() / len(a) + b.var() / len(b)) + 1e-6 + 1e-3 * abs(a.mean())
            if abs(a.mean() - b.mean()) > MAX_STANDARD_ERRORS * error:
                return (
                    f"{name}: the mean {what} of {len(a)} and {len(b)} episodes is {a.mean():.4g} "
                    f"isolated and {b.mean():.4g} in the grid"
                )
    return ""


def _episodes(recording: Recording, policy: str) -> tuple[NDArray[Any], ...]:
    """Return the lengths and the returns of all complete episodes."""
    first = recording.frames[0].batches[policy]
    tracker = EpisodeTracker(first.num_agents, None)
    tracker.begin(slice(None), first)
    for frame in recording.frames[1:]:
        tracker.record(slice(None), frame.batches[policy])
    return np.array(tracker.lengths), np.array(tracker.returns)
