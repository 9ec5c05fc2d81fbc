"""Which policy learns when: phases of modes, one after the other and over again."""

from __future__ import annotations

import bisect
from collections.abc import Mapping
from itertools import accumulate

from ludus.errors import ConfigError
from ludus.settings.policy_config import Mode
from ludus.settings.train_config import Phase, TrainConfig

__all__ = ["ModeSchedule"]


class ModeSchedule:
    """The modes that a config asks for at each moment of a run.

    Args:
        config: With settings of every policy.

    Raises:
        ConfigError: A phase names a policy that the game does not have.
    """

    def __init__(self, config: TrainConfig) -> None:
        self._base: dict[str, Mode] = {name: of.mode for name, of in config.policies.items()}
        self._phases = config.schedule or _turns(self._base, config.alternate_every)
        *self._starts, self._length = accumulate([0, *(phase.updates for phase in self._phases)])
        for phase in self._phases:
            if unknown := sorted(phase.modes.keys() - self._base.keys()):
                known = ", ".join(self._base)
                raise ConfigError(
                    f"schedule: there is no policy {unknown[0]}", f"policies of the game: {known}"
                )

    def at(self, updates: int) -> Mapping[str, Mode]:
        """Return the mode of each policy after ``updates`` updates."""
        if not self._phases:
            return self._base
        index = bisect.bisect_right(self._starts, updates % self._length) - 1
        modes = self._phases[index].modes
        return {name: modes.get(name, mode) for name, mode in self._base.items()}

    def is_change(self, updates: int) -> bool:
        """Return whether a phase begins after ``updates`` updates; the first one does at 0."""
        return updates == 0 or (bool(self._phases) and updates % self._length in self._starts)


def _turns(base: Mapping[str, Mode], updates: int | None) -> tuple[Phase, ...]:
    """Return phases in which the policies that learn take turns."""
    learning = [name for name, mode in base.items() if mode == "train"]
    if updates is None or len(learning) < 2:
        return ()
    return tuple(
        Phase(updates, {other: "frozen" for other in learning if other != name})
        for name in learning
    )
