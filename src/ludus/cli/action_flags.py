"""``--stochastic`` and ``--deterministic``, which mean the same in every command."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

if TYPE_CHECKING:
    from ludus.play.players import Stochastic

__all__ = ["ActionFlags"]


@dataclass(frozen=True, kw_only=True)
class ActionFlags:
    """How trained agents choose their actions.

    Attributes:
        stochastic: Draw each action from the policy's probabilities, as in training, instead of
            always taking the most probable one.
        deterministic: Always take the most probable action, as agents do without either flag.
    """

    stochastic: bool = False
    deterministic: bool = False

    def choose(self, *, default: bool = False) -> Stochastic:
        """Return which policies draw their actions; ``default`` where neither flag was given.

        Raises:
            ConfigError: Both were given.
        """
        from ludus.errors import ConfigError

        names = cast("bool | tuple[str, ...] | None", self.stochastic)  # names: ludus evaluate
        is_stochastic = names is not None and names is not False
        if is_stochastic and self.deterministic:
            raise ConfigError("--stochastic and --deterministic exclude each other")
        if not is_stochastic:
            return default and not self.deterministic
        return names or True
