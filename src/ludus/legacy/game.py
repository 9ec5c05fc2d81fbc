"""What a bridge must offer so that its games can be driven as any other: :class:`LegacyGame`."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from gymnasium import spaces
from numpy.typing import NDArray

from ludus.errors import UsageError

__all__ = ["POLICY", "Declaration", "LegacyGame", "Outcome", "check_reset_parameters"]

POLICY = "agent"
"""Name of the policy where the wire knows no names."""


@dataclass(frozen=True, kw_only=True)
class Declaration:
    """Agents of a game that share a policy, as the user or the game declares them.

    Attributes:
        name: The game, for messages.
        observation_space: What one agent observes: a box, or a dictionary of boxes.
        action_space: What one agent does: discrete, multi-discrete, multi-binary, a bounded box.
        num_agents: How many have these spaces.
        steps_per_second: Steps in one second of game time.
        policy: Name of their policy.
        rows: Their places among all agents of the game; None: they are all.
        is_restarting: Whether the game begins the next episode of an agent by itself, in the step
            that ends one. If not, episodes begin together: an agent that ends early waits until
            all have ended.
        read: Makes arrays by entry, ``[n, *shape]``, of what the game says that n of the agents
            observe, or raises ``GameError``; None: it says elements of the observation space.
    """

    name: str
    observation_space: spaces.Space[Any]
    action_space: spaces.Space[Any]
    num_agents: int = 1
    steps_per_second: float = 60.0
    policy: str = POLICY
    rows: tuple[int, ...] | None = None
    is_restarting: bool = False
    read: Callable[[Sequence[Any]], Mapping[str, NDArray[Any]]] | None = None


class Outcome(NamedTuple):
    """What a step led to; one element per agent, in the same order every time.

    What it says of agents whose episode had ended before is ignored.

    Attributes:
        observations: Elements of the observation space, or what ``Declaration.read`` takes.
        rewards: Numbers.
        terminated: Whether the agent's episode has ended by itself.
        truncated: Whether it was broken off.
        active: Whether an agent that restarts by itself acts on its observation; None: all do.
    """

    observations: Sequence[Any]
    rewards: Sequence[float]
    terminated: Sequence[bool]
    truncated: Sequence[bool]
    active: Sequence[bool] | None = None


class LegacyGame(ABC):
    """One running game that speaks the wire of a legacy bridge.

    :meth:`reset` comes first, then :meth:`send` and :meth:`receive` in turn, or a reset again; the
    caller sees to that order. Every wait has a deadline. When a method raises, the caller closes
    the game.

    Args:
        declarations: One per policy; they never change. :attr:`declaration` is the first.
    """

    methods: Mapping[str, Callable[..., Any]] = {}
    """What ``Session.call`` reaches, by name; takes and returns plain JSON."""
    pid: int | None = None
    """Process id of the game; None if somebody else started it."""

    def __init__(self, *declarations: Declaration) -> None:
        self.declarations = declarations
        self.declaration = declarations[0]

    @abstractmethod
    def reset(self, seed: int | None, parameters: Mapping[str, Any] | None) -> Sequence[Any]:
        """Begin an episode of all agents; return one first observation for each.

        Args:
            seed: 0 … 2⁶⁴ - 1; None goes on with the random stream. No legacy wire has seeds: it
                has no effect.
            parameters: What the user gave for this and the following episodes; None changes
                nothing.

        Raises:
            UsageError: The wire has no such parameters.
            GameError: An observation does not fit its space.
            EngineError: The game failed.
        """

    @abstractmethod
    def send(self, actions: Sequence[Any]) -> None:
        """Begin a step, and return at once.

        Args:
            actions: An element of the action space for each agent; None for agents whose
                episode has ended.

        Raises:
            ActionError: An action does not fit.
            EngineError: The game failed.
        """

    @abstractmethod
    def receive(self) -> Outcome:
        """Wait for the end of the step that :meth:`send` began.

        Raises:
            GameError: An observation or a reward is not finite, or has another shape.
            EngineError: The game failed.
        """

    @abstractmethod
    def close(self) -> None:
        """End the conversation, and the game if it is ours; may be called twice."""


def check_reset_parameters(
    parameters: Mapping[str, Any] | None, known: Sequence[str], hint: str
) -> None:
    """Refuse parameters of a reset that a bridge does not have.

    Raises:
        UsageError: There are some.
    """
    unknown = [key for key in parameters or {} if key not in known]
    if unknown:
        raise UsageError(f"unknown reset option {', '.join(map(repr, unknown))}", hint=hint)
