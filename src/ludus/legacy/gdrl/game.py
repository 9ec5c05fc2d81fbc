"""One running game of Godot RL Agents."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from gymnasium import spaces

from ludus.legacy.conversation import Conversation
from ludus.legacy.game import Declaration, LegacyGame, Outcome, check_reset_parameters
from ludus.legacy.gdrl.declaring import PolicyAgents
from ludus.legacy.gdrl.messages import (
    CLOSE_REQUEST,
    RESET_REQUEST,
    action_request,
    call_request,
    read_call,
    read_reset,
    read_step,
)
from ludus.legacy.gdrl.time_limits import TimeLimits

__all__ = ["GdrlGame"]

_QUIT_S = 3.0


class GdrlGame(LegacyGame):
    """A game whose agents begin their episodes one by one, by themselves.

    The wire has neither seeds nor parameters of a reset.

    Args:
        name: For messages.
        policies: What the game says of its agents.
        conversation: With the game; closed with this object.
        steps_per_second: Steps in one second of game time.
        time_limits: Of the game's agents.
    """

    def __init__(
        self,
        name: str,
        policies: Sequence[PolicyAgents],
        conversation: Conversation[bytes],
        steps_per_second: float,
        time_limits: TimeLimits,
    ) -> None:
        super().__init__(
            *(
                Declaration(
                    name=name,
                    observation_space=policy.observation_space,
                    action_space=policy.actions,
                    num_agents=len(policy.rows),
                    steps_per_second=steps_per_second,
                    policy=policy.name,
                    rows=policy.rows,
                    is_restarting=True,
                    read=policy.read,
                )
                for policy in policies
            )
        )
        self.methods = {"call": self.call}
        self._num_agents = sum(len(policy.rows) for policy in policies)
        self._conversation = conversation
        self.pid = conversation.pid
        self._time_limits = time_limits
        idle = {row: _idle_action(policy.actions) for policy in policies for row in policy.rows}
        self._idle = [idle[row] for row in range(self._num_agents)]

    def reset(self, seed: int | None, parameters: Mapping[str, Any] | None) -> Sequence[Any]:
        """Begin an episode of all agents; see :meth:`LegacyGame.reset`.

        The game answers with what its agents observe after one step, and goes on for another
        before it takes an action, both with the actions of the old episode. So these are set to
        nothing first, and its agents are asked again, and told to forget rewards and ends.
        """
        check_reset_parameters(parameters, (), "a reset of Godot RL Agents takes nothing")
        self._conversation.note_errors()
        self.send([None] * self._num_agents)
        self.receive()
        found = self._conversation.ask(
            RESET_REQUEST, lambda message: read_reset(message, self._num_agents)
        )
        for method in ("zero_reward", "set_done_false"):
            self.call(method)
        fresh = self.call("get_obs")
        # Controllers that are not trained answer, too; which they are, the wire does not say.
        if len(fresh) == self._num_agents and all(isinstance(part, dict) for part in fresh):
            found = fresh
        self._time_limits.restart()
        return found

    def send(self, actions: Sequence[Any]) -> None:
        """Begin a step; see :meth:`LegacyGame.send`."""
        self._conversation.send(
            action_request(
                [
                    self._idle[row] if action is None else action
                    for row, action in enumerate(actions)
                ]
            )
        )

    def receive(self) -> Outcome:
        """Wait for the end of the step; see :meth:`LegacyGame.receive`."""
        answer = self._conversation.receive(lambda message: read_step(message, self._num_agents))
        terminated, truncated, active = self._time_limits.take(answer.is_done)
        return Outcome(answer.observations, answer.rewards, terminated, truncated, active)

    def call(self, method: str) -> list[Any]:
        """Call a method without arguments of every AIController; return what each returned.

        Raises:
            GameError: A script of the game failed.
            EngineError: The game failed.
        """
        return self._conversation.ask(call_request(method), read_call)

    def close(self) -> None:
        """Ask the game to quit, and end what is still there; may be called twice."""
        if self._conversation.is_open:
            self._conversation.say_goodbye(CLOSE_REQUEST, _QUIT_S)
        self._conversation.close()


def _idle_action(space: spaces.Dict) -> dict[str, Any]:
    """Return what the game is told to do with an agent that stands aside."""
    return {
        name: 0 if isinstance(part, spaces.Discrete) else [0.0] * part.shape[0]
        for name, part in space.spaces.items()
        if part.shape is not None
    }
