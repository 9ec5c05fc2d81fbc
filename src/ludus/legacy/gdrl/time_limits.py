"""Which episodes end by a time limit of the game: its wire cannot say so.

An ``AIController`` counts physics ticks; after ``reset_after`` of them the game begins a new
episode. It reports an end as any other, or nothing at all, and the last observation is lost in
either case. Where the limit is known, the agent's episode is truncated one step before the jump
can come, where the last observation is at hand, and the agent stands aside until it has come.
"""

from __future__ import annotations

from collections.abc import Sequence

__all__ = ["TimeLimits"]

_LATE_TICKS = 3
"""How late a game begins an episode, at most: some compare their count with > and some with >=, and
their nodes hear of a reset one after the other."""


class TimeLimits:
    """Counts the ticks of the agents of one game.

    When an episode began, and so when it will end, is known to about one step: the agent stands
    aside for two steps or a few more, or until the game reports an end.

    Args:
        num_agents: All agents of the game.
        reset_after: Ticks after which the game begins a new episode; None: nobody knows.
        ticks_per_step: Ticks of one step.
    """

    def __init__(self, num_agents: int, reset_after: int | None, ticks_per_step: int) -> None:
        self._limit = reset_after
        self._ticks_per_step = ticks_per_step
        self._tick = 0
        self._earliest = [0] * num_agents
        self._latest = [0] * num_agents
        self._is_aside = [False] * num_agents

    def restart(self) -> None:
        """Begin with all agents: the game was reset, and two steps have passed since."""
        num_agents = len(self._is_aside)
        self._tick = 2 * self._ticks_per_step
        self._earliest = [0] * num_agents
        self._latest = [_LATE_TICKS] * num_agents
        self._is_aside = [False] * num_agents

    def take(self, is_done: Sequence[bool]) -> tuple[list[bool], list[bool], list[bool]]:
        """Take the ends that the game reports after a step.

        Returns:
            Per agent whether it was terminated, was truncated, and acts now.
        """
        self._tick += self._ticks_per_step
        num_agents = len(is_done)
        terminated, truncated = [False] * num_agents, [False] * num_agents
        if self._limit is None:
            return list(is_done), truncated, [True] * num_agents
        for row, has_ended in enumerate(is_done):
            was_aside = self._is_aside[row]
            terminated[row] = has_ended and not was_aside
            self._note_begin(row, self._limit, has_ended=has_ended)
            if not (self._is_aside[row] or terminated[row]):
                self._is_aside[row] = self._may_jump(row, self._limit)
                truncated[row] = self._is_aside[row] and not was_aside
        return terminated, truncated, [not is_aside for is_aside in self._is_aside]

    def _note_begin(self, row: int, limit: int, *, has_ended: bool) -> None:
        """Note that an episode has begun within the last step, if one has."""
        if has_ended:
            self._earliest[row] = self._tick - self._ticks_per_step
            self._latest[row] = self._tick + _LATE_TICKS
        elif self._is_aside[row] and self._tick >= self._latest[row] + limit:
            # How late it is adds up from one jump to the next, until the game reports an end.
            self._earliest[row] += limit
            most = self._earliest[row] + 2 * self._ticks_per_step + _LATE_TICKS
            self._latest[row] = min(self._latest[row] + limit + _LATE_TICKS, most)
        else:
            return
        self._is_aside[row] = False

    def _may_jump(self, row: int, limit: int) -> bool:
        """Tell whether the game may begin a new episode of an agent in the next step."""
        return self._tick + self._ticks_per_step >= self._earliest[row] + limit
