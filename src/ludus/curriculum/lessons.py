"""Lessons that follow each other: which one a run is in, and when it ends."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from typing import Any

from ludus.settings.world_parameters import Lesson, Parameter

__all__ = ["Lessons"]

log = logging.getLogger(__name__)


class Lessons:
    """Where a run is in its curriculum; without one, in a single lesson that never ends.

    Args:
        lessons: In order.
        randomise: Parameters in all lessons; those of a lesson win.

    Attributes:
        index: Of the lesson, from 0.
    """

    def __init__(self, lessons: Sequence[Lesson], randomise: Mapping[str, Parameter]) -> None:
        self._lessons = tuple(lessons) or (Lesson(),)
        self._randomise = dict(randomise)
        self._begun_at = 0
        self.index = 0

    @property
    def is_last(self) -> bool:
        """Whether no lesson follows."""
        return self.index == len(self._lessons) - 1

    @property
    def parameters(self) -> dict[str, Parameter]:
        """Parameters of the worlds in this lesson."""
        return {**self._randomise, **self._lessons[self.index].parameters}

    @property
    def has_parameters(self) -> bool:
        """Whether any lesson sets parameters of worlds."""
        return bool(self._randomise) or any(lesson.parameters for lesson in self._lessons)

    def advance(self, agent_steps: int, mean_returns: Sequence[float | None]) -> bool:
        """Go on to the next lesson if a threshold of this one is reached.

        Args:
            agent_steps: Of the run so far.
            mean_returns: Of each policy; None before it had a whole window of episodes.

        Returns:
            Whether the next lesson has begun.
        """
        lesson = self._lessons[self.index]
        steps = agent_steps - self._begun_at
        is_over = lesson.until_steps is not None and steps >= lesson.until_steps
        if lesson.until_return is not None:
            target = lesson.until_return
            is_over |= all(mean is not None and mean >= target for mean in mean_returns)
        if not is_over or self.is_last:
            return False
        self.index, self._begun_at = self.index + 1, agent_steps
        name = self._lessons[self.index].name or str(self.index + 1)
        log.info("lesson %s begins after %d agent steps; the last took %d", name, agent_steps,
                 steps)  # fmt: skip
        return True

    def finish(self) -> None:
        """Go to the last lesson, the whole task."""
        self.index = len(self._lessons) - 1

    def state(self) -> dict[str, Any]:
        """Return what a resumed run goes on with, as JSON values."""
        return {"index": self.index, "begun_at": self._begun_at}

    def load_state(self, state: Mapping[str, Any]) -> None:
        """Go on from :meth:`state`; in the last lesson if there are fewer now."""
        self.index = min(int(state["index"]), len(self._lessons) - 1)
        self._begun_at = int(state["begun_at"])
