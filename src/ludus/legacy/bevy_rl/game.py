"""A program with bevy_rl's REST interface, with what its user has declared."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, cast
from urllib.parse import quote

from ludus.errors import EngineCrashed, EngineTimeout, GameError, ProtocolError
from ludus.legacy.bevy_rl.http import HttpConversation, Response
from ludus.legacy.bevy_rl.observing import Observing
from ludus.legacy.game import Declaration, LegacyGame, Outcome, check_reset_parameters

__all__ = ["AgentAnswer", "BevyRlGame", "Client"]

_OURS = "bevy_ludus/"
_OK = 200
_OTHER_VERB = 405
_ENDED = 503
_LATE = 504
_EXCERPT = 300


class AgentAnswer(NamedTuple):
    """What an answer says of one agent."""

    reward: float
    is_terminated: bool


class Client:
    """The four endpoints of bevy_rl, as calls.

    ``bevy_ludus_rest`` sends the state along with the answer to a step; a program made with
    bevy_rl is asked for it in a second request. That one is not sent together with the first, as
    the program would then hold back the second answer until the first one is acknowledged, which
    takes 40 ms.

    Args:
        conversation: With the program; closed with this object.
        with_pixels: Ask for pictures with every state.

    Raises:
        EngineError: What listens there is not such a program, or it fails.
    """

    def __init__(self, conversation: HttpConversation, *, with_pixels: bool) -> None:
        self._conversation = conversation
        self._with_pixels = with_pixels
        self._state_request = conversation.request("GET", "/state")
        self._picture_request = conversation.request("GET", "/visual_observations")
        self._reset_request = conversation.request("GET", "/reset")
        self._is_ours = conversation.ask(self._state_request, _read_product).startswith(_OURS)

    def reset(self) -> list[AgentAnswer]:
        """Begin an episode of all agents; :meth:`observe` is next."""
        agents = self._conversation.ask(self._reset_request, _read_reset_or_none)
        if agents is None:
            # bevy_rl routes /reset for POST only up to 0.10.0-beta, for GET only from 0.10.0 on.
            self._reset_request = self._conversation.request("POST", "/reset")
            agents = self._conversation.ask(self._reset_request, _read_reset)
        return agents

    def observe(self) -> tuple[Any, bytes]:
        """Return state and picture; the picture is empty without pixels."""
        state = self._conversation.ask(
            self._state_request, lambda response: _read_json("/state", response)
        )
        return state, self._ask_for_picture()

    def send_step(self, actions: Sequence[str | None]) -> None:
        """Begin a step: one text or none per agent; :meth:`receive_step` is next."""
        payload = json.dumps([{"action": action} for action in actions])
        request = self._conversation.request
        if self._is_ours:
            step = request("POST", "/step?include=state", payload.encode())
        else:
            step = request("GET", f"/step?payload={quote(payload)}")
        self._conversation.send(step)

    def receive_step(self) -> tuple[list[AgentAnswer], Any, bytes]:
        """Return agents, state and picture as they are after the step."""
        answer = self._conversation.receive(lambda response: _read_json("/step", response))
        if self._is_ours:
            agents = _read_agents("/step", answer["agents"])
            return agents, answer["state"], self._ask_for_picture()
        return _read_agents("/step", answer), *self.observe()

    def close(self) -> None:
        """Close the connection; the program goes on. May be called twice."""
        self._conversation.close()

    def _ask_for_picture(self) -> bytes:
        if not self._with_pixels:
            return b""
        return self._conversation.ask(self._picture_request, _read_picture)


class BevyRlGame(LegacyGame):
    """All agents of a program. The wire has neither seeds nor parameters of a reset.

    Args:
        declaration: What the user says of the program.
        client: Closed with this object.
        observing: What agents see.
        to_action: Makes the text of an action.
        settle_s: How long to wait between a reset and the first look, seconds.
    """

    def __init__(
        self,
        declaration: Declaration,
        client: Client,
        observing: Observing,
        to_action: Callable[[Any], str],
        settle_s: float,
    ) -> None:
        super().__init__(declaration)
        self._client = client
        self._observing = observing
        self._to_action = to_action
        self._settle_s = settle_s

    def reset(self, seed: int | None, parameters: Mapping[str, Any] | None) -> Sequence[Any]:
        """Begin an episode; see :meth:`LegacyGame.reset`."""
        hint = "bevy_rl's reset takes nothing; Ludus's own plugin has parameters"
        check_reset_parameters(parameters, (), hint)
        self._check_count(self._client.reset())
        if self._settle_s:
            time.sleep(self._settle_s)
        return self._observing.observe(*self._client.observe(), self.declaration.num_agents)

    def send(self, actions: Sequence[Any]) -> None:
        """Begin a step; see :meth:`LegacyGame.send`."""
        texts = [None if action is None else self._to_action(action) for action in actions]
        self._client.send_step(texts)

    def receive(self) -> Outcome:
        """Wait for the end of the step; see :meth:`LegacyGame.receive`."""
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
        expected = self.declaration.num_agents
        if len(agents) != expected:
            raise ProtocolError(
                f"the program has {len(agents)} agents, expected {expected}",
                hint="num_agents must be that of its AIGymSettings; it may be left out",
            )


def _check_status(path: str, response: Response) -> None:
    if response.status == _OK:
        return
    reason = response.body.decode(errors="replace")[:_EXCERPT]
    text = f"{path} was answered with status {response.status}: {reason}"
    error = {_LATE: EngineTimeout, _ENDED: EngineCrashed}.get(response.status, GameError)
    raise error(text)


def _read_reset_or_none(response: Response) -> list[AgentAnswer] | None:
    return None if response.status == _OTHER_VERB else _read_reset(response)


def _read_reset(response: Response) -> list[AgentAnswer]:
    return _read_agents("/reset", _read_json("/reset", response))


def _read_product(response: Response) -> str:
    _read_json("/state", response)
    return response.product


def _read_picture(response: Response) -> bytes:
    _check_status("/visual_observations", response)
    return response.body


def _read_json(path: str, response: Response) -> Any:
    _check_status(path, response)
    try:
        return json.loads(response.body)
    except ValueError as error:
        # bevy_rl tells its reasons as text, with the status 200.
        text = response.body.decode(errors="replace")[:_EXCERPT]
        raise GameError(f"{path} was not answered with JSON: {text!r}") from error


def _read_agents(path: str, answer: Any) -> list[AgentAnswer]:
    try:
        agents = [_read_agent(one) for one in cast("list[Any]", answer)]
    except (KeyError, TypeError, ValueError):
        agents = []
    if not agents:
        raise ProtocolError(
            f'{path} was answered with {str(answer)[:_EXCERPT]}, expected a list of {{"reward": '
            f'number, "is_terminated": true or false}}, one for each agent',
            hint="is it a program made with bevy_rl that listens there?",
        )
    return agents


def _read_agent(one: Any) -> AgentAnswer:
    reward, is_terminated = one["reward"], one["is_terminated"]
    # NaN and infinity are null in JSON.
    return AgentAnswer(float("nan") if reward is None else float(reward), bool(is_terminated))
