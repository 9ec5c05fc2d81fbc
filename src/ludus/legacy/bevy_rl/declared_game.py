"""A program with bevy_rl's REST interface, with what its user has declared."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from ludus.errors import ProtocolError, UsageError
from ludus.legacy.bevy_rl.client import AgentAnswer, Client
from ludus.legacy.bevy_rl.observing import Observing
from ludus.legacy.game import Declaration, Outcome

__all__ = ["DeclaredGame", "to_json"]

ToAction = Callable[[Any], str]


class DeclaredGame:
    """A :class:`~ludus.legacy.game.LegacyGame`.

    The program's seed is its own affair: the wire has none.

    Args:
        client: Closed with this object.
        declaration: What the user says of the program.
        observing: What agents see.
        to_action: Makes the text of an action.
        settle_s: How long to wait between a reset and the first look, seconds.
    """

    methods: Mapping[str, Callable[..., Any]] = {}
    """None: the wire has no calls."""

    def __init__(
        self,
        client: Client,
        declaration: Declaration,
        observing: Observing,
        to_action: ToAction,
        settle_s: float,
    ) -> None:
        self._client = client
        self._declaration = declaration
        self._observing = observing
        self._to_action = to_action
        self._settle_s = settle_s

    @property
    def declaration(self) -> Declaration:
        """What the user says of it."""
        return self._declaration

    def reset(self, seed: int | None, parameters: Mapping[str, Any] | None) -> Sequence[Any]:
        """Begin an episode.

        Args:
            seed: Without effect.
            parameters: The wire has none.

        Raises:
            UsageError: There are parameters.
            GameError: The state does not fit the space.
            EngineError: The program failed.
        """
        if parameters:
            raise UsageError(
                f"unknown reset option {', '.join(map(str, parameters))}",
                hint="bevy_rl's reset takes nothing; Ludus's own plugin has parameters",
            )
        self._check_count(self._client.reset())
        if self._settle_s:
            time.sleep(self._settle_s)
        return self._observing.observe(*self._client.observe(), self._declaration.num_agents)

    def send(self, actions: Sequence[Any]) -> None:
        """Begin a step; errors as :meth:`LegacyGame.send`."""
        texts = [None if action is None else self._to_action(action) for action in actions]
        self._client.send_step(texts)

    def receive(self) -> Outcome:
        """Wait for the end of the step; errors as :meth:`LegacyGame.receive`."""
        agents, state, picture = self._client.receive_step()
        self._check_count(agents)
        observations = self._observing.observe(state, picture, len(agents))
        rewards = [agent.reward for agent in agents]
        ends = [agent.is_terminated for agent in agents]
        return Outcome(observations, rewards, ends, [False] * len(agents))

    def close(self) -> None:
        """Close the connection; the program goes on. May be called twice."""
        self._client.close()

    def _check_count(self, agents: Sequence[AgentAnswer]) -> None:
        expected = self._declaration.num_agents
        if len(agents) != expected:
            raise ProtocolError(
                f"the program has {len(agents)} agents, expected {expected}",
                hint="num_agents must be that of its AIGymSettings; leave it out to be told",
            )


def to_json(action: Any) -> str:
    """Return an action as JSON: a number, or a list of numbers."""
    return json.dumps(action.tolist() if hasattr(action, "tolist") else action)
